"""Linear models with names, an operating point and a verdict on how far they hold."""

from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.linearise import linearise
from workbench.linearisation.modes import find_modes
from workbench.linearisation.state_space import linear_model, to_iosystem
from workbench.linearisation.validity import amplitude_validity, frequency_validity

__all__ = [
    "LinearModel",
    "amplitude_validity",
    "find_modes",
    "frequency_validity",
    "linear_model",
    "linearise",
    "to_iosystem",
]
