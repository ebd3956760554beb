"""Seal friction of a pneumatic cylinder against its pressure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from workbench.data_folder import shipped_folder
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.refit_report import RefitTask
from workbench.model import Model
from workbench.plants.cylinder import cylinder
from workbench.recordings import Signal, read_recording, resample

RATE_HZ = 50.0
SMOOTHED = 11
"""Samples over which a parabola gives the speed, at 5 to 15 mm/s."""


def cylinder_task(find: Callable[[str], Path]) -> RefitTask:
    """Build the refit of a cylinder with O-ring: fitted at 1, 5 and 7 bar, judged at 3 bar.

    Args:
        find: Returns the path of a file of the data set by its name.

    Raises:
        WorkbenchError: If a file cannot be read.
    """
    model = cylinder()
    seen = {bar: _observed(model, find(f"O-ring_{bar}bar.csv")) for bar in (1, 3, 5, 7)}
    return RefitTask(
        name="cylinder",
        title="pneumatic cylinder, O-ring",
        model=model,
        fit=(seen[1], seen[5], seen[7]),
        hold_out=(seen[3],),
        notes=(
            "half of the difference between pushing and pulling grows from 5.6 N at 1 bar to 10.9 N"
            " at 7 bar in the recordings",
        ),
    )


def _observed(model: Model, path: Path) -> Observed:
    from scipy.signal import savgol_filter

    mapping = shipped_folder() / "mappings" / "seal-friction.toml"
    recording = resample(read_recording(path, mapping=mapping), rate_Hz=RATE_HZ)
    speed = savgol_filter(recording["position"], SMOOTHED, 2, deriv=1, delta=1 / RATE_HZ)
    signal = Signal("speed", np.asarray(speed), "m/s", role="command")
    return observe(model, recording.with_signal(signal))
