"""The paper's experiments on the arm: isometric ramps (Figure 7), open-loop pulses (Figure 8)."""

from workbench.experiments.isometric import (
    IsometricRecord,
    isometric_experiment,
    isometric_experiment_on_arm,
)
from workbench.experiments.open_loop import (
    OpenLoopExperiment,
    TransitFigures,
    measure_transits,
    open_loop_experiment,
    pulse_train,
)

__all__ = [
    "IsometricRecord",
    "OpenLoopExperiment",
    "TransitFigures",
    "isometric_experiment",
    "isometric_experiment_on_arm",
    "measure_transits",
    "open_loop_experiment",
    "pulse_train",
]
