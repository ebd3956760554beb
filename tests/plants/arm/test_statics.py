"""Static figures of the arm that follow from geometry and force law together."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.physics.force_laws import PHI_FLOOR, PHI_SWITCH, PaperLaw
from workbench.plants.arm.geometry import TRAVEL, ArmGeometry
from workbench.plants.arm.joint import ArmBody

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


def test_torque_of_the_antagonist_is_the_mirror_image() -> None:
    for angle in (0.0, 0.3, 1.0):
        assert muscle_torque(angle, 6e5, 1e5) == pytest.approx(
            -muscle_torque(TRAVEL - angle, 1e5, 6e5)
        )


def test_six_bar_lift_eight_plates_off_the_lower_stop_and_two_bar_do_not() -> None:
    body = ArmBody()
    # 30.8 N m at 0 deg against 52.6 N m
    assert muscle_torque(0.0, 6e5, 0.0) > float(body.gravity_torque(0.0, 8))
    assert muscle_torque(0.0, 2e5, 0.0) < float(body.gravity_torque(0.0, 8))


def test_isometric_ramps_return_the_coefficients() -> None:
    # The identification trial: slow ramps of 0..6 bar at several contractions. Straight lines per
    # contraction give D(q) and phi(q); polynomials through them give the coefficients.
    contraction = np.array([0.0, 1.0, 3.0, 7.0, 12.0, 17.0, 22.0, 27.0, 30.0]) * 1e-3
    pressure = np.linspace(0, 6e5, 121)
    gain, offset = [], []
    for q in contraction:
        force = LAW.force(q, pressure)
        pulls = force > 30.0  # below, the rounded clamp bends the line
        slope, intercept = np.polyfit(pressure[pulls], force[pulls], 1)
        gain.append(slope)
        offset.append(intercept)
    d3, d2, d1 = np.polyfit(1e3 * contraction, 1e5 * np.array(gain), 2)
    assert (d1, d2, d3) == pytest.approx((280.0, -2.2, 0.033), rel=2e-3)
    beyond = contraction > LAW.phi_switch
    poly = np.polyfit(1e3 * contraction[beyond], np.array(offset)[beyond], 4)[::-1]
    # the 5 mN that the clamp leaves at 50 N enter the constant of a quartic through seven points
    q = np.linspace(3.0, 30.0, 50)
    refitted = np.polynomial.polynomial.polyval(q, poly)
    assert np.allclose(refitted, LAW.phi(1e-3 * q), atol=0.1)
    assert offset[0] == pytest.approx(-9.2101, abs=0.02)
    # They meet where the polynomial first passes its floor.
    roots = np.polynomial.polynomial.polyroots(poly - np.eye(5)[0] * PHI_FLOOR)
    first = min(r.real for r in roots if abs(r.imag) < 1e-9 and r.real >= 0.0)
    assert first == pytest.approx(1e3 * PHI_SWITCH, abs=0.01)
