"""The EMPS axis: friction of a positioning system, measured in closed loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.data_folder import shipped_folder
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.refit_report import RefitTask
from workbench.plants.emps import PUBLISHED, emps, emps_in_loop
from workbench.recordings import Recording, read_recording

FILES = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
"""The recording to fit on and the one to judge on."""


def emps_task(find: Callable[[str], Path]) -> RefitTask:
    """Build the refit of the EMPS axis.

    Args:
        find: Returns the path of a file of the data set by its name.

    Returns:
        The refit, with the published values beside it.

    Raises:
        WorkbenchError: If a file cannot be read.
    """
    model = emps()
    mapping = shipped_folder() / "mappings" / "emps.toml"
    seen = [observe(model, read_recording(find(name), mapping=mapping)) for name in FILES]
    loop = emps_in_loop()
    mapping = shipped_folder() / "mappings" / "emps-loop.toml"
    driven = read_recording(find(FILES[1]), mapping=mapping, name="DATA_EMPS_PULSES, in its loop")
    return RefitTask(
        name="emps",
        title="EMPS axis",
        model=model,
        fit=(seen[0],),
        hold_out=(seen[1],),
        in_loop=((loop, observe(loop, _between(driven))),),
        published=PUBLISHED,
        published_from="A. Janot, M. Gautier, M. Brunot 2019, inverse dynamics, least squares",
        notes=(
            "force reaches the position through two integrations, so a free run drifts by what no"
            " parameter can hold: published free runs on the held-out recording are 5.53 mm (linear"
            " state space), 5.17, 4.61 and 2.64 mm (best network)",
        ),
    )


def _between(recording: Recording) -> Recording:
    """Take the goal in the middle of each sample.

    The controller compares goal and position at the same instant; a goal that is held while the
    position moves on would lag by half a sample, which at full speed is more than the encoder sees.
    """
    goal = recording.signal("goal")
    middle = goal.values + 0.5 * np.diff(goal.values, append=goal.values[-1])
    return recording.with_signal(replace(goal, values=middle))
