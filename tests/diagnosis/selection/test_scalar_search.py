"""Searches over one number whose cost falls far away only."""

from __future__ import annotations

import pytest

from workbench.diagnosis.selection.scalar_search import walked
from workbench.model import Parameter


@pytest.mark.parametrize(("upper", "found"), [(30.0, 8.5), (3.2, 3.0)])
def test_a_search_strides_over_a_first_step_that_wavers(upper: float, found: float) -> None:
    time = Parameter("time", "s", 1.0, value=0.0, lower=-1.0, upper=upper)
    looked: list[float] = []

    def cost(late: float) -> float:
        assert time.lower <= late <= time.upper
        looked.append(late)
        return abs(late - 8.5) + (3.0 if 0.0 < abs(late) < 1.0 else 0.0)

    assert walked(cost, 0.0, time, 0.5) == found
    assert len(set(looked)) == len(looked)
