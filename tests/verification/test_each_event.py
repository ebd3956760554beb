"""What an event did ends where the next event or step begins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from workbench.verification.each_step import response_to_each_event


def test_the_error_of_a_later_step_is_none_of_an_event() -> None:
    time = np.linspace(0.0, 4.0, 4001)
    reference = np.where(time < 3.0, 0.0, 10.0)
    dip = np.where((time >= 1.0) & (time < 1.5), 0.5, 0.0)
    run = SimpleNamespace(
        time=time,
        controlled=("angle",),
        references={"angle": reference},
        scenario=SimpleNamespace(
            changes=(SimpleNamespace(time=1.0, parameter="load"),),
            disturbances=(SimpleNamespace(time=2.0, port="joint.torque"),),
            references={"angle": SimpleNamespace(changes=((3.0, 0.0, 10.0),))},
            duration=4.0,
            sample_time=1e-3,
        ),
    )
    trajectory = {"angle": dip}
    measured = cast(
        Any, type("Measured", (SimpleNamespace,), {"__getitem__": lambda _, name: trajectory[name]})
    )
    first, second = response_to_each_event(measured(**vars(run)))
    assert (first.what, second.what) == ("load", "joint.torque")
    assert first.peak == pytest.approx(0.5) and second.peak == second.left == 0.0
