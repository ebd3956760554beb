"""The paper's trials on the arm: isometric ramps (Figure 7) and open-loop pulses (Figure 8)."""

from workbench.trials.isometric import IsometricRecord, isometric_trial, isometric_trial_on_arm
from workbench.trials.open_loop import OpenLoopTrial, open_loop_trial, pulse_train
from workbench.trials.transits import Transit, TransitFigures, measure_transits

__all__ = [
    "IsometricRecord",
    "OpenLoopTrial",
    "Transit",
    "TransitFigures",
    "isometric_trial",
    "isometric_trial_on_arm",
    "measure_transits",
    "open_loop_trial",
    "pulse_train",
]
