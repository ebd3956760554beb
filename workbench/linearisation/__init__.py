"""Linear models with names, an operating point and a verdict on how far they hold."""

from workbench.linearisation.kinks import Kink
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.linearise import linearise
from workbench.linearisation.modes import Mode, find_modes
from workbench.linearisation.validity import (
    AmplitudeValidity,
    FrequencyValidity,
    amplitude_validity,
    frequency_validity,
)
from workbench.linearisation.verdict import Swing, Verdict

__all__ = [
    "AmplitudeValidity",
    "FrequencyValidity",
    "Kink",
    "LinearModel",
    "Mode",
    "Swing",
    "Verdict",
    "amplitude_validity",
    "find_modes",
    "frequency_validity",
    "linearise",
]
