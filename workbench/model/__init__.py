"""The language in which plants are written: quantities, ports, effects, models."""

from workbench.model.effect import About, Effect
from workbench.model.model import Model
from workbench.model.quantities import Input, Output, Parameter, Quantity, State
from workbench.model.regularisation import EXACT, REGULARISED, Form
from workbench.model.scope import EffectView, Names, Port, PortView, Scope, ValidRange
from workbench.model.trace import Trace
from workbench.model.traits import ActuatorCurve, DriftingSum, Traits

__all__ = [
    "EXACT",
    "REGULARISED",
    "About",
    "ActuatorCurve",
    "DriftingSum",
    "Effect",
    "EffectView",
    "Form",
    "Input",
    "Model",
    "Names",
    "Output",
    "Parameter",
    "Port",
    "PortView",
    "Quantity",
    "Scope",
    "State",
    "Trace",
    "Traits",
    "ValidRange",
]
