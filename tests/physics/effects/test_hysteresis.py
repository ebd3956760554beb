"""Hysteresis: rate independence, closed minor loops, memory, dissipation, the single element."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.effects.bench import bench, position, run, triangle
from workbench.model import Effect
from workbench.physics.hysteresis import (
    muscle_hysteresis,
    muscle_slip,
    prandtl_ishlinskii,
    stretch_rate,
)

MM = 1e-3
GAUGE = 3e5
STEP = 2e-3
"""Longest step of the bench, in s."""


def maxwell() -> Effect:
    return muscle_slip(3)("muscle.force", level=10.0, growth=1e-5, spread=4.0)


def bouc_wen() -> Effect:
    return muscle_hysteresis(("muscle.force",), level=10.0, level_per_pressure=1e-4)


def softened() -> Effect:
    return muscle_hysteresis(
        ("muscle.force",), level=10.0, level_per_pressure=1e-4, exponent=1.5, gamma=0.5
    )


def ishlinskii() -> Effect:
    return prandtl_ishlinskii(3)("axis.force", level=40.0, breakaway=2.5e-4, spread=4.0)


LAWS = [maxwell, bouc_wen, softened, ishlinskii]
HALF_WIDTH = 40.0
"""Half width of all four at 3 bar, N."""


def loop(effect: Effect, turns: list[float], speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position and hysteresis force along a triangular path, at 3 bar."""
    muscle = effect.ports == ("muscle.force",)
    signals = ("contraction_speed", "gauge_pressure") if muscle else ("speed",)
    model = bench(effect, "N", *signals)
    path, ends, times = triangle(turns, speed)
    # What slips gives way within a millisecond: a step takes no longer.
    parts = int(np.ceil(np.diff(times).max() / (10 * STEP)))
    fine = np.interp(np.arange((len(times) - 1) * parts + 1), np.arange(len(times)) * parts, times)
    force = run(model, lambda t: {**path(t), "gauge_pressure": GAUGE}, fine)[::parts]
    return position(turns, ends, times), force


@pytest.mark.parametrize("law", LAWS)
def test_it_does_not_depend_on_the_rate(law) -> None:
    turns = [0.0, 6 * MM, 1 * MM, 4 * MM, -2 * MM]
    _, slow = loop(law(), turns, 1 * MM)
    _, fast = loop(law(), turns, 5 * MM)
    np.testing.assert_allclose(fast, slow, atol=0.02 * HALF_WIDTH)


@pytest.mark.parametrize("law", LAWS)
def test_long_motion_saturates_at_the_half_width(law) -> None:
    _, force = loop(law(), [0.0, 30 * MM], 1 * MM)
    assert force[-1] == pytest.approx(-HALF_WIDTH, rel=0.01)


@pytest.mark.parametrize("law", LAWS)
def test_a_cycle_dissipates(law) -> None:
    for amplitude in (0.1 * MM, 1 * MM, 10 * MM):
        turns = [0.0, amplitude, -amplitude, amplitude, -amplitude]
        q, force = loop(law(), turns, 1 * MM)
        last = slice(2 * 80, None)
        # The muscle pulls with contraction q: work done on the effect is minus its force times dq.
        work = -np.trapezoid(force[last], q[last])
        assert 0.0 < work < 4.0 * amplitude * HALF_WIDTH * 1.01


@pytest.mark.parametrize("law", [maxwell, ishlinskii])
def test_minor_loops_close_and_are_forgotten(law) -> None:
    """Madelung's rules, which Bouc-Wen's law is known to break."""
    outer = [0.0, 8 * MM, 2 * MM]
    q, force = loop(law(), [*outer, 4 * MM, 2 * MM, 4 * MM, 2 * MM, -4 * MM], 0.5 * MM)
    corners = force[::80]
    assert corners[4] == pytest.approx(corners[2], abs=0.03 * HALF_WIDTH)
    assert corners[6] == pytest.approx(corners[4], abs=0.03 * HALF_WIDTH)
    _, direct = loop(law(), [*outer[:2], -4 * MM], 0.5 * MM)
    assert force[-1] == pytest.approx(direct[-1], abs=0.03 * HALF_WIDTH)
    assert len(q) == len(force)


def test_one_element_is_a_spring_behind_a_dry_contact() -> None:
    effect = prandtl_ishlinskii(1)("axis.force", level=10.0, breakaway=1 * MM)
    q, force = loop(effect, [0.0, 3 * MM, -3 * MM], 1 * MM)
    z, stop = 0.0, [0.0]
    for dq in np.diff(q):
        z = float(np.clip(z + dq / MM, -1.0, 1.0))
        stop.append(-10.0 * z)
    np.testing.assert_allclose(force, stop, atol=0.05)
    assert abs(force[80] + 10.0) < 0.05
    unloading = (force[90] - force[80]) / (q[90] - q[80])
    assert unloading == pytest.approx(-10.0 / MM, rel=0.05)


@pytest.mark.parametrize("speed", [0.1 * MM, 10 * MM, 100 * MM])
def test_a_swing_is_remembered_as_by_the_stop_operator_at_any_speed(speed: float) -> None:
    """A muscle on the arm moves by 100 mm/s, and turns in some tens of milliseconds."""
    slips = (0.2 * MM, 0.8 * MM)
    wave = 2.0 * MM
    rate = speed / wave
    times = np.linspace(0.0, 4.0 * np.pi / rate, 4001)
    path = wave * np.sin(rate * times) * np.exp(-0.1 * rate * times)
    v = np.gradient(path, times)
    effect = prandtl_ishlinskii(2)("axis.force", level=10.0, breakaway=slips[0], spread=4.0)
    model = bench(effect, "N", "speed")
    force = run(model, lambda t: {"speed": float(np.interp(t, times, v))}, times)
    exact = np.zeros_like(times)
    for slip in slips:
        z = 0.0
        for i, dq in enumerate(np.diff(path), start=1):
            z = float(np.clip(z + dq / slip, -1.0, 1.0))
            exact[i] -= 5.0 * z
    np.testing.assert_allclose(force, exact, atol=0.4)


def test_a_contact_slips_at_its_stretch_and_gives_way_beyond() -> None:
    assert float(stretch_rate(2.0, 0.5, 0.1)) == pytest.approx(20.0)
    assert float(stretch_rate(2.0, 1.02, 0.1, time=1e-3)) == pytest.approx(0.0, abs=1e-9)
    assert float(stretch_rate(0.0, -1.1, 0.1, time=1e-3)) == pytest.approx(100.0)


def test_the_loop_widens_with_pressure() -> None:
    model = bench(maxwell(), "N", "contraction_speed", "gauge_pressure")
    path, _, times = triangle([0.0, 20 * MM], 1 * MM)
    widths = [
        -run(model, lambda t, p=p: {**path(t), "gauge_pressure": p}, times)[-1]
        for p in (0.0, 2e5, 6e5)
    ]
    assert widths == pytest.approx([10.0, 30.0, 70.0], rel=0.01)
