"""Linear models with names, an operating point and a verdict on how far they hold."""

from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.linearise import linearise
from workbench.linearisation.modes import Mode, find_modes
from workbench.linearisation.state_space import linear_model, to_iosystem
from workbench.linearisation.validity import (
    AmplitudeValidity,
    DescribingFunction,
    FrequencyValidity,
    Kink,
    Validity,
    amplitude_validity,
    frequency_validity,
)

__all__ = [
    "AmplitudeValidity",
    "DescribingFunction",
    "FrequencyValidity",
    "Kink",
    "LinearModel",
    "Mode",
    "Validity",
    "amplitude_validity",
    "find_modes",
    "frequency_validity",
    "linear_model",
    "linearise",
    "to_iosystem",
]
