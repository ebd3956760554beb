"""The picture of a nonparametric term shows what it was given, and refuses what was not fitted."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.diagnosis.nonparametric.result import Argument, Bins
from workbench.errors import WorkbenchError
from workbench.reports.figures.diagnosis import diagnosis_nonparametric

X = np.linspace(-0.5, 0.5, 15)


def test_classes_and_curve_are_drawn_in_readable_units() -> None:
    argument = Argument("angle", "rad", 0.01, 0.7, (-0.5, 0.5), Bins(X, 2 * X, 0.1 + 0 * X, 3 * X))
    axes = diagnosis_nonparametric(argument, place="joint.torque", unit="N m").axes[0]
    assert axes.get_xlabel() == "angle in °" and axes.get_ylabel() == "joint.torque in N m"
    dots, line = axes.get_lines()[:2]
    assert np.allclose(dots.get_ydata(), 2 * X) and np.allclose(line.get_ydata(), 3 * X)
    assert np.allclose(line.get_xdata(), np.degrees(X))


def test_nothing_fitted_is_refused() -> None:
    bare = Argument("angle", "rad", 0.5, 0.0, (0.0, 1.0))
    with pytest.raises(WorkbenchError, match="nothing to draw"):
        diagnosis_nonparametric(bare, place="joint.torque", unit="N m")
