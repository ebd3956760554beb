"""What a signal depends on is told alike for recordings of milliseconds and of hours."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.diagnosis.nonparametric.dependence import Evidence


@pytest.mark.parametrize("step", [1e-6, 0.01, 30.0])
def test_a_column_predicts_other_blocks_at_every_scale(step: float) -> None:
    rng = np.random.default_rng(0)
    seen, other = rng.normal(size=(2, 600, 1))
    evidence = Evidence(
        located=("port",),
        signal=seen[:, 0] + 0.3 * rng.normal(size=600),
        known=np.ones(600, dtype=bool),
        nominal=np.zeros((600, 0)),
        toward=np.zeros(0),
        sites=(),
        time=step * np.arange(600),
        recording=np.zeros(600, dtype=int),
    )
    assert evidence.share(seen) == pytest.approx(1 / (1 + 0.3**2), abs=0.05)
    assert abs(evidence.share(other)) < 0.05
