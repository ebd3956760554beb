"""Linear models against independent derivatives, laws and systems."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import control as ct
import numpy as np
import pytest

from tests.machines import at_rest, machine
from tests.physics.numbers_of import iso6358
from workbench.errors import WorkbenchError
from workbench.linearisation import linearise, to_iosystem
from workbench.linearisation.actuator_inverse import ActuatorInverse, straightened_point
from workbench.operating_point import OperatingPoint, operating_point
from workbench.plants.arm import arm
from workbench.plants.arm.arm import two_valve_arm
from workbench.plants.servo_axis import servo_axis

ARM = arm(3.0)
AMBIENT = 1.01325e5


def at(angle_deg: float, mean_bar: float | None = 3.0) -> OperatingPoint:
    mean = {} if mean_bar is None else {"mean_pressure": mean_bar * 1e5}
    return operating_point(ARM, {"angle": math.radians(angle_deg), **mean})


def scaled(matrix: np.ndarray) -> np.ndarray:
    size = np.array([q.scale for q in ARM.states])
    return np.asarray(matrix * size / size[:, None])


def test_matrices_agree_with_control_away_from_kinks() -> None:
    # At 17 deg the spool stands 72 mV from the centre, between two corners of its curve.
    point = at(17.0)
    linear = linearise(point, amplitude={})
    crossed = ct.linearize(to_iosystem(ARM), point.x, point.u)
    # Forward differences of 1e-6 on pressures of 4e5 Pa lose half their digits.
    assert np.allclose(
        scaled(linear.A), scaled(crossed.A), atol=2e-4 * np.abs(scaled(linear.A)).max()
    )
    for i in range(8):
        row = np.abs(scaled(linear.A)[i]).max()
        assert np.allclose(scaled(linear.A)[i], scaled(crossed.A)[i], atol=2e-3 * row)
    assert np.allclose(linear.B, crossed.B, rtol=1e-5)
    assert np.allclose(linear.C, crossed.C, rtol=1e-4, atol=1e-4)


def test_finite_differences_take_one_side_and_automatic_ones_the_mean() -> None:
    point = at(30.0)
    linear = linearise(point, amplitude={})
    (kink,) = [k for k in linear.verdict.kinks if k.name == "spool"]
    assert kink.distance == 0.0
    p1, spool = ARM_STATES.index("pressure_1"), ARM_STATES.index("spool")
    crossed = ct.linearize(to_iosystem(ARM), point.x, point.u)
    assert crossed.A[p1, spool] == pytest.approx(kink.above.A[p1, spool], rel=1e-4)
    mean = 0.5 * (kink.below.A[p1, spool] + kink.above.A[p1, spool])
    assert linear.A[p1, spool] == pytest.approx(mean, rel=1e-4)
    assert abs(crossed.A[p1, spool] / linear.A[p1, spool] - 1) > 0.1


ARM_STATES = [q.name for q in ARM.states]


def test_filling_and_venting_gains_are_those_of_the_restriction() -> None:
    (kink,) = [k for k in linearise(at(30.0)).verdict.kinks if k.name == "spool"]
    p, supply = 3e5 + AMBIENT, 6e5 + AMBIENT
    fill = iso6358(supply, p, 293.15, 2.9e-8, 0.23)
    vent = iso6358(p, AMBIENT, 293.15, 2.9e-8, 0.23)
    # The gas in the muscle is 1.4 K warmer than the supply.
    assert kink.factor == pytest.approx(float(fill / vent), rel=0.01)
    mean = 0.5 * (kink.slope_below + kink.slope_above)
    assert mean == pytest.approx(linearise(at(30.0)).A[2, 0], rel=1e-3)


def test_at_the_pressure_that_leakage_holds_filling_is_as_fast_as_venting() -> None:
    # Leakage holds the pressure at which both flows through equal edges are equal.
    assert not [k for k in linearise(at(30.0, None)).verdict.kinks if k.distance == 0.0]


def test_a_kink_nearby_is_found_where_it_is() -> None:
    linear = linearise(at(5.0), input="opening")
    (kink,) = [k for k in linear.verdict.kinks if k.name == "spool"]
    # The centre of the valve; found by nine bisections of 50 mV.
    assert kink.distance == pytest.approx(-linear.x0[ARM_STATES.index("spool")], abs=2e-4)
    assert kink.factor > 2.0


def test_the_stop_is_a_kink_and_the_model_stands_on_the_free_side() -> None:
    linear = linearise(at(0.0))
    kink = linear.verdict.kinks[0]
    assert kink.name == "angle" and kink.distance == 0.0
    assert linear.mode_of("angle").frequency_hz < 3.0
    assert kink.below.mode_of("angle").frequency_hz > 15.0


def test_dry_friction_has_the_slope_of_its_describing_function() -> None:
    axis = servo_axis()
    point = operating_point(axis)
    swing = linearise(point, amplitude={"speed": 0.05})
    # 4 F / (pi a); the transition of 1 mm/s takes (1 mm/s / a)^2 off.
    coulomb = 4 * 20.0 / (math.pi * 0.05)
    assert -95.0 * swing.A[1, 1] == pytest.approx(200.0 + coulomb, rel=3e-3)
    assert -95.0 * linearise(point, amplitude={}).A[1, 1] == pytest.approx(200.0 + 20.0 / 1e-3)
    (told,) = swing.verdict.describing_functions
    assert told.name == "speed" and told.over_oscillation == swing.A[1, 1]


def test_linear_slopes_do_not_depend_on_the_amplitude() -> None:
    smooth = ARM.without("bearing_friction")
    point = operating_point(smooth, {"angle": 0.4, "mean_pressure": 3e5})
    assert np.array_equal(linearise(point).A, linearise(point, amplitude={}).A)
    assert linearise(point).verdict.describing_functions == ()


def test_regularised_form_agrees_next_to_the_kink() -> None:
    point = at(30.0)
    exact, smooth = linearise(point), linearise(point, form="regularised")
    assert scaled(smooth.A) == pytest.approx(scaled(exact.A), rel=2e-2, abs=2.0)


def test_opening_is_the_input_of_a_plant_with_inverted_curve() -> None:
    point = at(30.0)
    linear = linearise(point, input="opening")
    assert linear.input_names == ("opening",)
    (kink,) = [k for k in linear.verdict.kinks if k.name == "spool"]
    p1, spool = ARM_STATES.index("pressure_1"), ARM_STATES.index("spool")
    for volt, side in ((0.9, kink.above), (-0.9, kink.below)):
        x = point.x.copy()
        x[spool] = volt
        # The true plant at 5.6 % opening: flow is proportional to the opening; what leaves
        # is 1.4 K warmer than what enters.
        secant = (ARM.rates(x, point.u)[p1] - point.rates[p1]) / math.copysign(0.056, volt)
        assert 5.0 * side.A[p1, spool] == pytest.approx(secant, rel=0.01)


def test_inverse_gives_the_voltage_of_an_opening() -> None:
    linear = linearise(at(30.0), input="opening")
    for wanted in (-0.36, -0.002, 0.0, 0.0101, 0.24):
        voltage = float(linear.to_plant(wanted))
        signals = ARM.signals(ARM.initial_state({"spool": voltage - 5.0}), [voltage])
        assert signals["valve.supply_1"] - signals["valve.supply_2"] == pytest.approx(wanted)
    assert linear.to_plant([2.0, -2.0]).tolist() == [10.0, 0.0]


def test_each_of_two_valves_has_its_curve() -> None:
    plant = two_valve_arm(3.0)
    point = operating_point(plant, {"angle": math.radians(40.0), "mean_pressure": 3e5})
    curves = plant.traits.curves
    straight = straightened_point(point, curves)
    assert straight.rates == pytest.approx(point.rates, abs=1.0)
    for k, curve in enumerate(curves):
        inverse = ActuatorInverse(point, curve)
        assert float(inverse(straight.x[2 * k] / 5.0)) == pytest.approx(point.u[k], abs=1e-6)
        for volt, wanted in ((7.0, 0.36), (3.6, -0.17)):
            x, u = point.x.copy(), point.u.copy()
            x[2 * k], u[k] = volt - 5.0, volt
            assert curve.value(plant.signals(x, u)) == pytest.approx(wanted)
            assert float(inverse(wanted)) == pytest.approx(volt)
    with pytest.raises(WorkbenchError, match="has 2 inputs"):
        linearise(point, input="opening_1")


def test_opening_of_the_operating_point_gives_its_voltage() -> None:
    point = at(12.0)
    linear = linearise(point, input="opening")
    assert float(linear.to_plant(linear.u0)[0]) == pytest.approx(point.u[0], abs=1e-9)
    assert linear.drift == pytest.approx(point.rates, abs=1e-3)


def test_a_plant_without_valve_has_no_opening() -> None:
    with pytest.raises(WorkbenchError, match="input is 'opening'"):
        linearise(operating_point(servo_axis()), input="opening")


@pytest.mark.parametrize("amplitude", [{"sped": 1.0}, {"speed": 0.0}, {"speed": math.inf}])
def test_wrong_amplitudes_are_refused(amplitude: dict[str, float]) -> None:
    with pytest.raises(WorkbenchError):
        linearise(at(30.0), amplitude=amplitude)


def test_control_moves_a_sampled_input_by_half_a_sample() -> None:
    axis = servo_axis().without("coulomb_friction")
    h = 0.02
    time = h * np.arange(200)
    force = 50.0 * np.sin(2 * math.pi * time)
    held = linearise(operating_point(axis)).response(force, h)[:, 0]
    _, interpolated = ct.input_output_response(to_iosystem(axis), time, force)
    later = np.interp(time - h / 2, time, np.ravel(interpolated))
    late, at_once = np.abs(later - held)[2:], np.abs(np.ravel(interpolated) - held)[2:]
    # What remains is of the order of the sample over the period.
    assert late.max() < 0.3 * at_once.max()


def test_a_slope_that_passes_zero_smoothly_is_no_kink() -> None:
    def equations(m):
        swing, rope = m.x.swing, m.x.rope
        rates = {
            "swing": m.x.rate,
            "rate": (-9.81 * ca.sin(swing) - m.u.pull * ca.cos(swing)) / rope - 0.1 * m.x.rate,
            "rope": m.u.winch,
        }
        return rates, {"swing": swing}

    crane = machine(
        equations,
        # A rope of any length: its size is a guess, and a poor one.
        "swing rad scale=7, rate rad/s scale=0.04, rope m 4 scale=4e3",
        "pull m/s2 scale=4, winch m/s scale=0.5",
        "swing rad scale=7",
    )
    assert linearise(operating_point(crane, {"rope": 4.0})).verdict.kinks == ()


def test_play_and_overlap_are_led_through_and_no_end_of_the_model() -> None:
    def gear(m: Any) -> Any:
        twist = m.x.motor - m.x.load
        torque = 5.0 * np.where(
            twist > 0.01, twist - 0.01, np.where(twist < -0.01, twist + 0.01, 0.0)
        )
        rates = {"motor": m.x.fast, "fast": (0.05 * m.u.volts - 0.01 * m.x.fast - torque) / 2e-4}
        return {**rates, "load": m.x.slow, "slow": (torque - 1e-4 * m.x.slow) / 4e-4}

    states = "motor rad, fast rad/s, load rad, slow rad/s"
    servo = machine(gear, states, "volts V -24 24", "load rad resolution=1e-3")
    linear = linearise(operating_point(servo))
    # Within the play no voltage moves the load; both sides of it turn together.
    assert linear.A[3, 0] == pytest.approx(5.0 / 4e-4, rel=0.02)
    assert linear.A[1] @ [1.0, 0.0, 1.0, 0.0] == pytest.approx(0.0, abs=1e-9)
    assert "slope of d slow/dt by load" in str(linear.verdict) or "by motor" in str(linear.verdict)
    assert linearise(operating_point(servo), amplitude={}).A[3, 0] == 0.0

    def valve(past: Any) -> float:
        cylinder = machine(
            lambda m: {"x": (0.5 * past(m.u.spool) - m.x.x) / 0.03},
            "x m/s",
            "spool 1 -1 1",
            "x m/s",
        )
        return float(at_rest(cylinder).B[0, 0]) * 0.03 / 0.5

    overlap = valve(lambda u: np.where(u > 0.05, u - 0.05, np.minimum(u + 0.05, 0.0)))
    assert 0.9 < overlap < 1.0
    # A smooth one has no slope at rest either: 3 / 4 of the cube of its amplitude.
    assert valve(lambda u: u**3) == pytest.approx(0.75)


def test_a_contact_that_is_only_read_does_not_stiffen_what_moves_freely() -> None:
    def cell(m: Any) -> Any:
        deep = np.where(m.x.x > 0.04, m.x.x - 0.04, np.where(m.x.x < -0.04, m.x.x + 0.04, 0.0))
        return {"x": m.x.v, "v": m.u.force - 50.0 * deep}, {"x": m.x.x, "contact": 50.0 * deep}

    made = machine(cell, "x m scale=0.1, v m/s", "force N -8 8", "x m, contact N")
    assert at_rest(made).A[1, 0] == 0.0


def test_a_belt_that_sticks_at_rest_is_linearised_where_it_moves() -> None:
    def belt(bend: Any) -> float:
        made = machine(
            lambda m: (
                {"speed": (m.u.force - 40.0 * m.x.speed - bend(m)) / 200.0},
                {"y": m.x.speed},
            ),
            "speed m/s",
            "force N -800 800",
            "y m/s",
        )
        return float(-200.0 * at_rest(made).A[0, 0])

    # Friction of 120 N over some 10 m/s, not 120 N over 1 cm/s.
    assert 40.0 < belt(lambda m: 120.0 * ca.tanh(m.x.speed / 0.01)) < 80.0
    # What bends to one side is what it is where it rests.
    assert belt(lambda m: 120.0 * (1.0 - ca.exp(-m.x.speed / 0.01))) == pytest.approx(12040.0)
