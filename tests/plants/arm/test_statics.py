"""Static figures of the arm that follow from geometry and force law together."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.physics.force_laws import PaperLaw
from workbench.plants.arm.geometry import ArmGeometry

LAW = PaperLaw.variant("corrected")
ARM = ArmGeometry()


def muscle_torque(angle: float, p1: float, p2: float) -> float:
    """Joint torque of both muscles, N m, for gauge pressures in Pa."""
    (q1, q2), (r1, r2) = ARM.contractions(angle), ARM.moment_arms(angle)
    return -float(LAW.force(q1, p1) * r1 + LAW.force(q2, p2) * r2)


def test_torque_at_six_bar() -> None:
    torques = [muscle_torque(np.radians(a), 6e5, 0.0) for a in range(0, 61, 10)]
    # Table printed to 0.1 N m; the empty muscle's rounded clamp adds less than 1 mN m.
    assert torques == pytest.approx([52.6, 47.5, 41.5, 36.1, 30.7, 25.0, 19.2], abs=0.06)
