"""The time of a plant comes from its linear model, whether that is a circuit or a furnace."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import control as ct
import numpy as np
import pytest

from tests.machines import at_rest, machine
from workbench.linearisation import linear_model, linearise
from workbench.linearisation.time_scales import (
    farthest,
    horizon_of,
    least_time,
    reach_of,
    step_time,
    usual_sample_time,
)
from workbench.model import Model, Scope
from workbench.operating_point import operating_point


def lag(time: float, integrates: bool = False) -> Model:
    """A first-order lag, with an integrator behind it or not."""
    return machine(
        lambda m: (
            {"x": (m.u.u - m.x.x) / m.p.time, **({"sum": m.x.x} if integrates else {})},
            {"y": m.x.x},
        ),
        "x K" + integrates * ", sum K s",
        "u K -10 10",
        "y K",
        f"time s {time}",
    )


@pytest.mark.parametrize("time", [3e-6, 0.2, 2500.0])
@pytest.mark.parametrize("integrates", [False, True])
def test_three_lags_at_every_scale(time: float, integrates: bool) -> None:
    linear = at_rest(lag(time, integrates))
    assert horizon_of(linear) == pytest.approx(3.0 * time)
    shown = step_time(linear)
    assert 2.0 <= shown / horizon_of(linear) < 5.0 + 1e-9
    assert float(f"{shown:.0e}") == shown and f"{shown:.0e}"[0] in "125"


def test_a_slow_plant_is_tried_over_its_own_time() -> None:
    verdict = linearise(operating_point(lag(2500.0))).verdict
    holds, agrees = verdict.amplitude, verdict.frequency
    assert holds.horizon == pytest.approx(7500.0, rel=0.01)
    assert holds.moves.max() > 9.0 and np.all(holds.errors < 1e-3)
    assert agrees.agrees.all() and agrees.upper < 0.01


def test_what_integrates_goes_as_far_whatever_slows_it_down() -> None:
    def reach(damping: float) -> float:
        body, swing = ct.tf([1.0], [1.0, damping, 0.0]), ct.tf([900.0], [1.0, 2.0, 900.0])
        known = linear_model(body * swing, limits={"u": (-1.0, 1.0)}).operating_point.model
        # Equations of which nobody knows that they are linear.
        plant = replace(known, equations=lambda m: known.equations(m))
        return reach_of(at_rest(plant), "y")

    # A body on a spring that swings far faster than it is slowed down.
    assert 0.5 < reach(0.001) / reach(0.1) < 2.0


def test_a_fast_valve_does_not_set_the_pace_of_a_furnace() -> None:
    """Two periods of its spool, 0.13 s, are not the time in which anything gets warm."""
    valve = linear_model("3 / ((10 s + 1) (1e-4 s^2 + 0.01 s + 1))", limits={"u": (-1.0, 1.0)})
    # All of the command warms by 0.3 a second: by a quarter of how far it goes in 1.2 s.
    far = valve.operating_point.model.outputs[0].scale
    assert 1.0 < 0.25 * far / 0.3 < horizon_of(valve) < 1.3 * 0.25 * far / 0.3
    late = linear_model("2 exp(-0.001 s) / (s (0.5 s + 1))", limits={"u": (-5.0, 5.0)})
    assert 0.1 < horizon_of(late) < 1.5


def test_an_output_alone_has_its_own_pace() -> None:
    """A load swings below what carries it; neither its designs nor its steps need its angle."""
    crane = machine(
        lambda m: (
            {"x": m.x.v, "v": m.u.f - 0.2 * m.x.v, "angle": m.x.w, "w": -m.u.f - 10.0 * m.x.angle},
            {"x": m.x.x, "angle": m.x.angle},
        ),
        "x m, v m/s, angle rad, w rad/s",
        "f N -1 1",
        "x m, angle rad",
    )
    alone = at_rest(crane).select(outputs=["x"])
    assert horizon_of(alone) > 0.0 and reach_of(alone, "x") > 0.0


def test_a_gain_alone_is_a_plant() -> None:
    assert len(at_rest(linear_model(ct.tf(2.0, 1.0)).operating_point.model).A) == 0


@pytest.mark.parametrize("late", [0.0, 0.001, 0.1, 10.0])
def test_a_delay_does_not_make_a_step_tiny(late: float) -> None:
    behind = f"exp(-{late} s)" if late else "1"
    ended = linear_model(f"2 {behind} / (s (0.5 s + 1))", limits={"u": (-5.0, 5.0)})
    assert reach_of(ended, "y") == 1.0
    assert reach_of(linear_model(f"2 {behind} / (s (0.5 s + 1))"), "y") == 1.0


def pipe(late: float) -> Model:
    """A tank that fills at the end of a pipe, its delay by a Pade function of first order."""
    return machine(
        lambda m: {
            "on_the_way": 2.0 / late * (m.u.u - m.x.on_the_way),
            "level": 2.0 * m.x.on_the_way - m.u.u,
        },
        "on_the_way m/s, level m",
        "u m/s -1 1",
        "level m",
    )


@pytest.mark.parametrize("late", [0.01, 1.0, 100.0])
def test_what_goes_the_wrong_way_first_is_given_time(late: float) -> None:
    filled = at_rest(pipe(late))
    # Five times the time in which the level is back where it was, at 1 m/s.
    assert 2.0 * late < reach_of(filled, "level") < 10.0 * late


def test_an_unstable_plant_is_sampled_before_it_grows() -> None:
    def sampled(growth: float) -> float:
        system = ct.ss(np.diag([-0.1, growth]), [[1.0], [1.0]], np.eye(2), 0)
        return usual_sample_time(linear_model(system))

    # Three lags of 10 s, twice: a step of 100 s.
    assert sampled(-5.0) == sampled(0.2) == pytest.approx(0.1)
    assert 0.01 < 5.0 * sampled(5.0) <= 0.05


def test_a_mode_that_grows_is_called_unstable() -> None:
    linear = linear_model(ct.ss([[5.0]], [[1.0]], [[1.0]], 0))
    assert str(linear.modes[0]).split() == ["mode", "unstable", "pole", "5", "rad/s", "x_0"]


def test_hours_behind_milliseconds_are_no_integrator() -> None:
    assert step_time(linear_model("1/((1e-4 s + 1)(3600 s + 1))")) == pytest.approx(5e4)
    assert step_time(linear_model("1/(s (1e-4 s + 1))")) < 1.0


def test_a_plant_that_answers_before_its_slowest_part_is_sampled_for_what_it_answers() -> None:
    both = linear_model("1/(0.05 s + 1) + 0.2/(7200 s + 1)")
    assert usual_sample_time(both, ("y",)) == pytest.approx(0.05)
    # It answers by nothing else than its slowest part.
    assert usual_sample_time(linear_model("1/((s + 1)(3600 s + 1))"), ("y",)) == pytest.approx(50.0)


def test_what_a_controlled_output_does_not_show_slows_no_samples_down() -> None:
    """A spindle that warms its windings in hours."""
    spindle = machine(
        lambda m: (
            {
                "speed": 20.0 * (2.5 * m.u.volts - m.x.speed),
                "warm": (0.05 * m.x.speed**2 - 0.5 * m.x.warm) / 3600.0,
            },
            {"speed": m.x.speed, "warm": m.x.warm},
        ),
        "speed rad/s 20, warm K 40",
        "volts V -24 24",
        "speed rad/s, warm K",
    )
    linear = at_rest(spindle)
    assert usual_sample_time(linear) == pytest.approx(50.0)
    # As of a lag of 50 ms alone.
    alone = usual_sample_time(linear.select(outputs=("speed",)).without_unseen(), ("speed",))
    assert usual_sample_time(linear, ("speed",)) == alone < 0.001
    assert least_time(linear, ("volts",), {"speed": 10.0}) < 0.05


def test_what_rings_is_as_far_as_it_was() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        return {"way": m.x.speed, "speed": m.u.push - m.x.way - 0.02 * m.x.speed}

    model = machine(equations, "way m 1, speed m/s 1", "push N -1 1", "way m", "")
    rested = at_rest(model)
    # A turn after it began it is about where it was; half a turn after it was farthest.
    far = farthest(rested, "way", np.pi)
    assert farthest(rested, "way", 2.0 * np.pi) == pytest.approx(far, rel=0.01)


def test_what_a_command_does_at_once_counts_for_how_far_it_takes_an_output() -> None:
    """A gate lets through more at once, and less when the tank behind it has sunk."""
    gate = machine(
        lambda m: ({"level": -0.01 * m.x.level - 0.002 * m.u.gate}, {"flow": m.x.level + m.u.gate}),
        "level 1",
        "gate 1 -1 1",
        "flow 1",
    )
    assert farthest(at_rest(gate), "flow", 1.0) == pytest.approx(1.0, rel=0.03)
    assert least_time(at_rest(gate), ("gate",), {"flow": 0.5}) < 1.0


def test_how_far_commands_reach_differs_to_each_side() -> None:
    chilled = machine(
        lambda m: ({"warm": m.u.cold - m.x.warm}, {"warm": m.x.warm}),
        "warm K 3 scale=1",
        "cold K 0 4 3",
        "warm K",
    )
    up, down = (farthest(at_rest(chilled), "warm", 20.0, up=way) for way in (True, False))
    assert (up, down) == pytest.approx((1.0, 3.0), rel=1e-3)
    endless = machine(
        lambda m: ({"x": m.u.drive - m.x.x}, {"x": m.x.x}), "x m scale=1", "drive m", "x m"
    )
    assert farthest(at_rest(endless), "x", 1.0) == np.inf
