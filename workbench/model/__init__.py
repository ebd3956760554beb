"""The language in which plants are written: quantities, ports, effects, models."""

from workbench.model.effect import About, Effect
from workbench.model.face import EXACT, SMOOTH, Face
from workbench.model.model import Model
from workbench.model.quantities import Input, Output, Parameter, Quantity, State
from workbench.model.scope import EffectView, Names, Port, PortView, Scope, ValidRange
from workbench.model.trace import Trace
from workbench.model.traits import ActuatorCurve, DriftingSum, Traits

__all__ = [
    "EXACT",
    "SMOOTH",
    "About",
    "ActuatorCurve",
    "DriftingSum",
    "Effect",
    "EffectView",
    "Face",
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
