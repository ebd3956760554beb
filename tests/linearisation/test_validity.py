"""How far a linear model holds on the full plant."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.machines import machine
from workbench.errors import WorkbenchError
from workbench.linearisation import amplitude_validity, frequency_validity, linearise
from workbench.linearisation.validity import FrequencyValidity
from workbench.operating_point import operating_point
from workbench.physics.friction import coulomb_friction
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.simulation import simulate

ARM = arm(3.0)
POINT = operating_point(ARM, {"angle": math.radians(30), "mean_pressure": 3e5})
OPENING = linearise(POINT, input="opening")


def test_a_linear_plant_holds_everywhere() -> None:
    axis = servo_axis().without("coulomb_friction")
    linear = linearise(operating_point(axis))
    holds = linear.verdict.amplitude
    assert holds.upper == pytest.approx(350.0)
    assert holds.errors.max() < 1e-4  # tolerance of the integrator
    assert linear.verdict.frequency.agrees.all()


def test_the_band_of_steps_ends_where_the_deviation_passes_the_limit() -> None:
    holds = OPENING.verdict.amplitude
    assert 0.0 < holds.lower < holds.upper < 0.05
    beyond = holds.amplitudes > holds.upper
    assert (holds.errors[beyond] > holds.within).all()
    inside = (holds.amplitudes >= holds.lower) & (holds.amplitudes <= holds.upper)
    assert (holds.errors[inside] <= holds.within).all()


def test_the_band_of_steps_agrees_with_a_run_made_by_hand() -> None:
    # At a true equilibrium nothing has to be taken off the plant.
    point = operating_point(ARM, {"angle": math.radians(30)})
    linear = linearise(point, input="opening")
    holds = amplitude_validity(linear)
    step, error = holds.amplitudes[-1], holds.errors[-1]
    deviations = []
    for sign in (1.0, -1.0):
        command = np.full(round(holds.horizon / 0.002), linear.u0[0] + sign * step)
        run = simulate(ARM, linear.to_plant(command), sample_time=0.002, start=point.x, check=False)
        predicted = linear.response(command, 0.002)[:, 0]
        move = np.abs(predicted - linear.y0[0]).max()
        deviations.append(np.abs(run["angle"] - predicted).max() / move)
    assert max(deviations) == pytest.approx(error, rel=1e-3)


def test_sines_agree_below_the_resonance() -> None:
    agree = OPENING.verdict.frequency
    assert agree.lower < 0.5 < agree.upper
    text = str(OPENING.verdict)
    assert "steps of opening" in text and "sines of opening" in text


def test_friction_left_out_of_the_model_is_noticed() -> None:
    free = linearise(operating_point(servo_axis().without("coulomb_friction")))
    rubbing = (
        servo_axis()
        .without("coulomb_friction")
        .with_effect(coulomb_friction("axis.force", level=60.0, transition_speed=1e-3, upper=100.0))
    )
    point = operating_point(rubbing)
    wrong = replace(free, operating_point=point)
    assert math.isnan(amplitude_validity(wrong, within=0.05).upper)
    assert "none holds" in str(amplitude_validity(wrong, within=0.05))
    assert not frequency_validity(wrong).agrees.all()


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="deviation"):
        amplitude_validity(OPENING, within=-1.0)


def test_a_band_of_one_frequency_is_no_range() -> None:
    one = np.ones(2)
    alone = FrequencyValidity("u", "y", 0.233, 0.2331, one, one, one, 0 * one)
    assert str(alone).endswith("at 0.233 Hz alone")


def test_steps_are_written_in_the_unit_in_which_people_read_the_input() -> None:
    heater = machine(
        lambda m: {"warm": (m.u.power - m.x.warm) / 50.0},
        "warm K scale=1",
        "power 1 0 1 0.5 scale=1 display_unit=%",
        "warm 1 scale=1",
    )
    told = str(amplitude_validity(linearise(operating_point(heater, {"power": 0.5}))))
    assert "to 50 % (warm moves up to 0.475); closest" in told and "closest at 50 % with" in told


def test_steps_of_an_unstable_plant_end_before_it_has_run_away() -> None:
    plasma = machine(
        lambda m: {"z": 60 * m.x.z + 0.02 * m.x.i, "i": (m.u.v - 0.1 * m.x.i) / 0.03},
        "z m scale=0.01, i A scale=50",
        "v V -100 100 scale=100",
        "z m scale=0.01",
    )
    holds = linearise(operating_point(plasma)).verdict.amplitude
    assert holds.horizon == pytest.approx(3.0 / 60.0, rel=0.05)
    assert holds.errors.max() < 1e-4 and holds.moves.max() < 1.0


def test_no_sine_is_tried_on_what_grows_before_it_shows() -> None:
    body = machine(
        lambda m: {
            "speed": 0.385 * m.u.torque - 0.24 * m.x.speed - 10.0 * m.x.pitch,
            "pitch": m.x.rate,
            "rate": 28.3 * m.x.pitch - 0.645 * m.u.torque + 0.34 * m.x.speed,
        },
        "speed m/s, pitch rad, rate 1/s",
        "torque N m -60 60",
        "speed m/s",
    )
    # It had grown beyond all numbers, with warnings, before the first period was over.
    found = linearise(operating_point(body)).verdict.frequency
    assert str(found) == "sines of torque: none can be tried, as the plant grows"
