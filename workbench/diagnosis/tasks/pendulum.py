"""A geared servo with a pendulum: motor and gear friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.data_folder import shipped_folder
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.refit_report import RefitTask
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.plants.servo_pendulum import servo_pendulum
from workbench.recordings import Signal, read_recording, resample

RATE_HZ = 200.0
MODEL_ERROR = 0.03
"""Error that the equations are expected to leave, in rad; the encoder's steps are far below it."""

HELD_OUT = "sin_sin"
"""The motion that is held out, at every setting of the position loop."""

TIMES = (
    "10h28m10", "10h28m17", "10h28m24", "10h28m32", "10h28m42", "10h28m49", "10h28m57", "10h29m04",
    "10h29m14", "10h29m21", "10h29m29", "10h29m37", "10h29m47", "10h29m54", "10h30m02", "10h30m10",
)  # fmt: skip
"""When the runs were recorded, which is what their files are called after."""


def pendulum_task(find: Callable[[str], Path]) -> RefitTask:
    """Build the refit of the servo with its pendulum: three motions to fit on, one to judge on.

    Args:
        find: Returns the path of a file of the data set by its name.

    Raises:
        WorkbenchError: If a file cannot be read.
    """
    model = servo_pendulum()
    fit: list[Observed] = []
    hold_out: list[Observed] = []
    for stamp in TIMES:
        observed = _observed(model, find(f"xl330_2026-01-15_{stamp}.json"))
        (hold_out if observed.name.startswith(HELD_OUT) else fit).append(observed)
    return RefitTask(
        name="pendulum",
        title="servo with pendulum",
        model=model,
        fit=tuple(fit),
        hold_out=tuple(hold_out),
        stages=(3.0, 0.3, 0.03),
        noise_known=False,
        notes=(
            "dry friction with rounded reversals creeps where the servo sticks; what is left are"
            " plateaus at the wrong angle",
        ),
    )


def _observed(model: Model, path: Path) -> Observed:
    mapping = shipped_folder() / "mappings" / "servo-pendulum.toml"
    recording = read_recording(path, mapping=mapping)
    setting, motion = recording.metadata.get("kp"), recording.metadata.get("trajectory")
    if setting is None or motion is None:
        raise WorkbenchError(f"{path.name} does not say kp and trajectory; is it of the data set?")
    recording = resample(recording, rate_Hz=RATE_HZ)
    gain = Signal("gain", np.full(len(recording), float(setting)), "1", role="command")
    named = replace(recording, name=f"{motion}, setting {setting}")
    observed = observe(model, named.with_signal(gain))
    return replace(observed, noise_rms=np.array([MODEL_ERROR]))
