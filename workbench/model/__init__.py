"""The language in which plants are written: quantities, ports, effects, models."""

from workbench.model.effect import About, Effect
from workbench.model.face import EXACT, SMOOTH, Face
from workbench.model.model import Model
from workbench.model.quantities import Input, Output, Parameter, Quantity, State
from workbench.model.scope import EffectView, Names, Port, PortView, Scope, ValidRange
from workbench.model.trace import Trace

__all__ = [
    "EXACT",
    "SMOOTH",
    "About",
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
    "ValidRange",
]
