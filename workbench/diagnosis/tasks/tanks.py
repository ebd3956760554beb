"""Cascaded tanks: levels with overflow, upper level never read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.data_folder import shipped_folder
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.refit_report import RefitTask
from workbench.plants.cascaded_tanks import cascaded_tanks
from workbench.recordings import read_recording

MODEL_ERROR = 0.2
"""Error that the equations are expected to leave, in V; the sensor's noise is far below it."""


def tanks_task(find: Callable[[str], Path]) -> RefitTask:
    """Build the refit of the cascaded tanks.

    Args:
        find: Returns the path of a file of the data set by its name.

    Returns:
        The refit, which takes the error of the equations as noise of the reading: the test is the
        free run over an hour, not the next sample.

    Raises:
        WorkbenchError: If the file cannot be read.
    """
    model = cascaded_tanks()
    seen = []
    for part in ("estimation", "test"):
        mapping = shipped_folder() / "mappings" / f"cascaded-tanks-{part}.toml"
        recording = read_recording(find("dataBenchmark.csv"), mapping=mapping, name=part)
        observed = observe(model, recording)
        seen.append(replace(observed, noise_rms=np.array([MODEL_ERROR])))
    return RefitTask(
        name="tanks",
        title="cascaded tanks",
        model=model,
        fit=(seen[0],),
        hold_out=(seen[1],),
        stages=(1.0, 0.1, 0.01),
        start_samples=50,
        noise_known=False,
        starts=4,
        notes=(
            "published free runs on the held-out recording: 0.588 V (linear), 0.45, 0.413, 0.396,"
            " 0.33, 0.306 and 0.191 V (best, a physical model of Worden et al. 2018)",
            "the level of the upper tank at the start is estimated from the first 50 samples",
        ),
    )
