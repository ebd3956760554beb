"""Faults of signals: lag, delay, slew, dead band, play, limits, drift, offset and gain."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.diagnosis.newcomers import oscillator
from tests.machines import at_rest, machine
from tests.physics.effects.bench import bench, held, offered, read, response, run, triangle
from workbench.linearisation.transfer import transfer_function
from workbench.model import Model, Scope, State
from workbench.model.trace import Equations
from workbench.model.units import same_dimension
from workbench.physics.delay import delay, sensor_delay, sensor_lag
from workbench.physics.drift import sensor_drift, sensor_fade
from workbench.physics.library import library
from workbench.physics.play import (
    command_hysteresis,
    command_play,
    command_stiction,
    lost_motion,
    play,
    spool_hysteresis,
)
from workbench.physics.recorded_facts import RecordedFacts, argument_of
from workbench.physics.saturation import (
    slew_limit,
)
from workbench.physics.stiffness import sensor_ripple
from workbench.physics.supply import supply_drift
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.simulation.simulate import simulate


def one_lag(time: float):
    return bench(sensor_lag("p.reading", time=time), "Pa")


def one_delay(time: float):
    return bench(sensor_delay("a.reading", time=time), "rad")


def late_command(time: float):
    return bench(delay("valve.command", time=time), "V")


def test_lag_is_a_lead_lag_with_the_delay_of_its_time() -> None:
    for time in (0.0, 0.01, 0.06):
        for w in (0.1, 5.0, 50.0):
            floor = 1e-3  # half of 2 ms
            spare = floor * math.exp(-time / floor)
            exact = (1 + 1j * w * spare) / (1 + 1j * w * (time + spare))
            assert response(one_lag(time), w) == pytest.approx(exact, rel=1e-9)
    # At low frequency the phase is that of a delay of the same time.
    assert np.angle(response(one_lag(0.06), 0.1)) == pytest.approx(-0.006, rel=1e-3)
    # Far beyond the floor it is the plain lag: 60 ms, up to 3 Hz, within 0.1 %.
    plain = 1 / (1 + 0.06j * 19.0)
    assert abs(response(one_lag(0.06), 19.0) - plain) < 0.001


def test_delay_follows_the_exponential() -> None:
    for time in (-0.001, 0.0, 0.005, 0.02):
        for w in (1.0, 10.0, 30.0):
            # The first term that is left out is of fourth order, in the signal and in the floor.
            bound = ((w * abs(time)) ** 4 + (w * 0.004) ** 4) / 12 + 1e-12
            assert abs(response(one_delay(time), w) - np.exp(-1j * w * time)) < bound


def test_delay_of_a_long_time_is_the_inverse_of_a_taylor_series() -> None:
    D, w = 0.2, 7.0
    s = 1j * w * D / 2
    taylor = 1 / (1 + s + s * s / 2 + s**3 / 6)
    # One after the other, for each half of the delay.
    assert response(one_delay(D), w) == pytest.approx(taylor**2, abs=1e-3)


def test_delay_can_be_inverted_by_a_filter() -> None:
    # Unstable zeros turn the phase the other way at high frequency than stable ones.
    for time in (-0.0005, 0.002, 0.01):
        high = response(one_delay(time), 1e6)
        assert high.real > 0.0
        assert abs(np.angle(high)) < 0.1


def test_zero_delay_is_the_identity_at_every_frequency() -> None:
    for w in (1.0, 100.0, 1e4):
        assert response(one_delay(0.0), w) == pytest.approx(1.0, abs=1e-9)
        assert response(late_command(0.0), w) == pytest.approx(1.0, abs=1e-9)


def test_each_half_of_a_delayed_command_is_pade_of_second_over_third_order() -> None:
    D = 0.1
    for w in (1.0, 10.0, 30.0, 60.0):
        s = 1j * w * D / 2
        pade = (1 - 2 * s / 5 + s * s / 20) / (1 + 3 * s / 5 + 3 * s * s / 20 + s**3 / 60)
        assert response(late_command(D), w) == pytest.approx(pade**2, abs=4e-3)
    # One Pade function of the whole misses half of it.
    assert abs(response(late_command(D), 50.0) - np.exp(-50j * D)) < 0.06


def test_a_delay_of_two_samples_is_one_to_a_thousandth_of_a_quick_signal() -> None:
    for w in (20.0, 60.0, 100.0):
        assert response(late_command(0.01), w) == pytest.approx(np.exp(-0.01j * w), abs=2e-3)


def test_delayed_command_arrives_after_its_time_on_average() -> None:
    model = bench(delay("valve.command", time=0.01), "V")
    times = np.linspace(0.0, 0.1, 2001)
    step = run(model, lambda t: {"value": 1.0 if t > 0 else 0.0}, times)
    # The area between command and answer is the mean delay.
    assert np.trapezoid(1.0 - step, times) == pytest.approx(0.01, rel=0.02)
    assert step[-1] == pytest.approx(1.0, abs=1e-6)
    assert abs(step[1]) < 0.2


def test_slew_limit_bounds_the_speed_and_settles() -> None:
    model = bench(slew_limit("valve.command", largest_rate=1000.0), "V")
    times = np.linspace(0.0, 0.02, 401)
    step = run(model, lambda t: {"value": 5.0 if t > 0 else 0.0}, times)
    assert np.max(np.diff(step) / np.diff(times)) == pytest.approx(1000.0, rel=1e-3)
    # 5 V at 1000 V/s take 5 ms but for the last volt, which is a lag of 1 ms.
    assert np.interp(2.5, step, times) == pytest.approx(2.5e-3, rel=0.05)
    assert step[-1] == pytest.approx(5.0, abs=1e-4)


def test_a_spool_with_a_top_speed_is_slowed_behind_its_own_dynamics() -> None:
    """Against a spool of second order that is stopped at its top speed, in small steps."""
    frequency, damping, top, h = 2 * np.pi * 95.0, 0.7, 120.0, 1e-5
    free, held = [], []
    for speed_limit, kept in ((np.inf, free), (top, held)):
        x = v = 0.0
        for _ in range(4000):
            kept.append(x)
            x += h * v
            v += h * (frequency**2 * (1.2 - x) - 2 * damping * frequency * v)
            v = min(max(v, -speed_limit), speed_limit)
    times = h * np.arange(4000)
    assert offered(arm(), "slew_limit").ports == ("valve.spool",)
    model = bench(slew_limit("valve.spool", largest_rate=top), "V")
    slowed = run(model, lambda t: {"value": float(np.interp(t, times, free))}, times[::20])
    late = np.trapezoid(np.array(held)[::20] - slowed, times[::20]) / 1.2
    # At the command it would be slowed before the spool, whose own lag is 2.3 ms.
    assert abs(late) < 1e-3


def test_play_holds_until_its_slack_is_taken_up() -> None:
    effect = play("valve.spool", half_width=0.1, floor=1e-3)
    model = bench(effect, "V", "speed")
    turns = [0.0, 1.0, 0.0]
    path, ends, times = triangle(turns, 1.0)
    u = np.interp(times, ends, turns)
    y = run(model, lambda t: {**path(t), "value": float(np.interp(t, ends, turns))}, times)
    up, down = slice(20, 80), slice(110, 160)
    np.testing.assert_allclose(y[up], u[up] - 0.1, atol=2e-3)
    np.testing.assert_allclose(y[down], u[down] + 0.1, atol=2e-3)
    # Half way through the slack of 0.2 after the reversal, nothing has moved yet.
    assert np.interp(-0.9, -u[80:], y[80:]) == pytest.approx(0.9, abs=0.01)


def test_play_of_a_held_command_follows_jumps_at_once_and_keeps_small_ones_back() -> None:
    model = bench(command_play("valve.command", half_width=0.1, floor=1e-4), "V")
    steps = np.array([0.0, 1.0, 0.9, 0.85, 0.7, 0.75, 2.0])
    # The play operator: what follows moves only as far as it must.
    expected, place = [], 0.0
    for u in steps:
        place = min(max(place, u - 0.1), u + 0.1)
        expected.append(place)
    parts = held(model, steps)
    np.testing.assert_allclose([part[-1] for part in parts], expected, atol=2e-3)
    assert parts[6][1] == pytest.approx(1.9, abs=2e-3)


def test_play_is_as_wide_as_it_is_told_where_commands_turn_at_every_sample() -> None:
    model = bench(command_play("valve.command", half_width=0.03), "V")
    interval = next(q.value for q in model.parameters if q.name == "command_play.time") / 0.4
    told = np.cumsum(np.random.default_rng(3).normal(0.0, 0.03, 60)).round(4)
    told[0], expected, place = 0.0, [], 0.0
    for u in told:
        place = min(max(place, u - 0.03), u + 0.03)
        expected.append(place)
    ends = np.array([part[-1] for part in held(model, told, interval)])
    assert np.sqrt(np.mean((ends - expected) ** 2)) < 2.5e-3


@pytest.mark.parametrize("bend", [-2.0, -1e-4, 0.0, 1e-4, 1.0])
def test_a_supply_that_runs_down_has_lost_its_amount_by_the_end(bend: float) -> None:
    ramp = {"amount": -0.4e5, "rate_constant": bend / 20.0, "lasting": 20.0}
    model = bench(supply_drift("supply.pressure", **ramp), "Pa")
    times = np.linspace(0.0, 20.0, 401)
    pressure = run(model, lambda t: {"value": 7e5}, times)
    # 2 kPa/s of a ramp; else ever more or ever less.
    share = times / 20.0
    if abs(bend) > 1e-3:
        share = np.expm1(-bend * share) / np.expm1(-bend)
    np.testing.assert_allclose(pressure, 7e5 - 4e4 * share, atol=3e-5 * 0.4e5)
    assert pressure[-1] == pytest.approx(6.6e5, rel=1e-6)
    assert offered(arm(), "supply_drift").ports == ("supply.pressure",)


def test_what_sticks_stays_and_then_goes_all_the_way_at_once() -> None:
    known = {"share": 1.0, "band": 0.3, "interval": 0.1}
    model = bench(command_stiction("valve.command", **known), "V")
    steps = np.array([0.0, 0.2, 0.29, 0.31, 0.4, 0.02, -0.1, 0.19, 0.21])
    # Stenman's recursion: s = u where |u - s| > band.
    expected, place = [], 0.0
    for u in steps:
        place = u if abs(u - place) > 0.3 else place
        expected.append(place)
    for part, place in zip(held(model, steps)[1:], expected[1:], strict=True):
        np.testing.assert_allclose(part[[1, -1]], place, atol=1e-3)


def test_a_loop_of_a_held_command_remembers_its_turning_points() -> None:
    known = {"level": 0.2, "reach": 0.1, "spread": 2.0, "growth": 1.0}
    model = bench(command_hysteresis("drive.command", **known), "V")
    steps = np.array([0.0, 1.0, 2.0, 1.9, 1.0, 1.3, 1.0, -1.0])
    # Prandtl and Ishlinskii: operators of 0.1, 0.2, 0.4 and 0.8 V, as high as they are wide.
    widths = 0.1 * 2.0 ** np.arange(4)
    expected, places = [], np.zeros(4)
    for u in steps:
        places = np.clip(places, u - widths, u + widths)
        expected.append(u - 0.2 * np.sum(u - places) / np.sum(widths))
    settled = [part[-1] for part in held(model, steps)]
    np.testing.assert_allclose(settled, expected, atol=2e-3)


def test_spool_hysteresis_has_the_width_of_its_loop() -> None:
    model = bench(spool_hysteresis("valve.spool", half_width=0.02, reach=0.05), "V", "speed")
    turns = [0.0, 1.0, -1.0, 1.0]
    path, ends, times = triangle(turns, 2.0)
    u = np.interp(times, ends, turns)
    y = run(model, lambda t: {**path(t), "value": float(np.interp(t, ends, turns))}, times)
    falling = np.interp(0.0, -u[80:160], y[80:160])
    rising = np.interp(0.0, u[160:240], y[160:240])
    assert falling - rising == pytest.approx(0.04, rel=0.01)


def test_drift_reaches_its_final_value() -> None:
    model = bench(sensor_drift(("p.reading",), amount=5e3, rate_constant=0.5), "Pa")
    times = np.linspace(0.0, 20.0, 201)
    y = run(model, lambda t: {}, times)
    assert y[0] == 0.0
    assert np.interp(2.0, times, y) == pytest.approx(5e3 * (1 - np.exp(-1.0)), rel=1e-3)
    assert y[-1] == pytest.approx(5e3, rel=1e-3)


def test_a_probe_that_fouls_reads_ever_less_of_what_is_there() -> None:
    fouled = sensor_fade(("p.reading",), amount=-0.2, rate_constant=0.5)
    times = np.linspace(0.0, 20.0, 201)
    y = run(bench(fouled, "Pa"), lambda t: {"value": 3.0}, times)
    assert y[0] == 3.0
    assert np.interp(2.0, times, y) == pytest.approx(3.0 - 0.6 * (1 - np.exp(-1.0)), rel=1e-3)
    assert y[-1] == pytest.approx(2.4, rel=1e-3)


def test_a_code_wheel_beside_its_axis_errs_once_a_turn() -> None:
    """The reading head looks at a circle of radius r whose centre goes round at e from the axis."""
    off, turn, places = 0.004, 0.7, np.linspace(-3.0, 3.0, 25)
    off_centre = sensor_ripple(("s.reading",), amplitude=off, frequency=1.0, phase=turn)
    model = bench(off_centre, "rad")
    # The line under the head is the direction of the head as seen from the centre of the circle.
    errs = np.arctan2(off * np.sin(places + turn), 1.0 - off * np.cos(places + turn))
    zero = np.arctan2(off * np.sin(turn), 1.0 - off * np.cos(turn))
    seen = [read(model, value=float(x)) for x in places]
    np.testing.assert_allclose(seen, places + errs - zero, atol=2.0 * off**2)


def test_times_of_lags_and_delays_follow_the_sampling_interval() -> None:
    for interval in (1e-5, 4.0):
        entries = library(
            servo_axis(), RecordedFacts(sample_time=interval, duration=1e3 * interval)
        )
        late = [e for e in entries if e.law in ("sensor_lag", "sensor_delay", "delay")]
        assert len(late) >= 2
        for entry in late:
            floor = next(q for q in entry.effect.parameters if q.name == "floor")
            assert 0.4 * interval < floor.value < 1.1 * interval
            assert 2 * interval < entry.typical_size < 30 * interval < entry.largest_size


def test_a_sensor_that_lags_is_not_offered_a_delay_as_well() -> None:
    axis = servo_axis()
    lag = offered(axis, "sensor_lag")
    laws = {e.law for e in library(axis.with_effect(lag.at_size(0.02))) if e.group == "sensor"}
    assert "sensor_delay" not in laws and {"sensor_offset", "sensor_gain"} <= laws


def test_the_limit_of_a_saturation_is_refitted() -> None:
    limits = [
        q
        for e in library(servo_axis())
        if e.law in ("saturation", "sensor_clipping")
        for q in e.effect.parameters
        if q.name == "limit"
    ]
    assert len(limits) == 2
    assert all(q.fitted and 0.0 < q.lower < 0.1 * q.value < 10 * q.value < q.upper for q in limits)


@pytest.mark.parametrize("time", [0.02, 0.1])
def test_a_sensor_that_filters_its_samples(time: float) -> None:
    h = 0.01
    axis, pushed = servo_axis(), np.repeat(np.random.default_rng(1).uniform(-200, 200, 40), 5)
    plain = simulate(axis, pushed, sample_time=h).outputs[:, 0]
    kept = np.exp(-h / time)
    filtered = plain.copy()
    for k in range(1, len(plain)):
        filtered[k] = kept * filtered[k - 1] + (1.0 - kept) * plain[k]

    def off(sampled: float) -> float:
        lag = sensor_lag("position.reading", time=time, sampled=sampled, floor=0.5 * h)
        read = simulate(axis.with_effect(lag), pushed, sample_time=h).outputs[:, 0]
        return float(np.abs(read - filtered).max() / np.abs(plain - filtered).max())

    assert off(1.0) < 0.02 < 0.04 < off(0.0)


@pytest.mark.parametrize(
    ("law", "values", "held"),
    [
        ("delay", {"time": 0.06}, lambda u: np.r_[np.zeros(3), u[:-3]]),
        ("saturation", {"share": 1.0, "limit": 0.6}, lambda u: np.clip(u, -0.6, 0.6)),
        ("dead_band", {"half_width": 0.3}, lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.3, 0)),
        ("gain", {"excess": 0.2}, lambda u: 1.2 * u),
    ],
)
def test_what_is_wrong_with_an_input_leaves_the_spring_beside_it_alone(
    law: str, values: dict[str, float], held: Callable[[np.ndarray], np.ndarray]
) -> None:
    model, step = oscillator(), 0.02
    entry = offered(model, law, sample_time=step)
    assert entry.name == f"{law}_drive" and entry.ports == ("mass.force",)
    drive = np.sin(2.0 * np.arange(300) * step)
    effect = entry.effect.with_parameters(values)
    run = simulate(model.with_effect(effect), drive[:, None], sample_time=step)
    # The same equations beside SciPy, with the input as it arrives.
    p = {q.name: q.value for q in model.parameters}
    x, read = np.zeros(2), []
    for u in held(drive):
        read.append(x[0])
        x = solve_ivp(
            lambda _, s, u=u: [
                s[1], (u - p["stiffness"] * s[0] - p["damping"] * s[1]) / p["mass"],
            ],
            (0.0, step), x, rtol=1e-8, atol=1e-10,
        ).y[:, -1]  # fmt: skip
    assert run.outputs[:, 0] == pytest.approx(np.array(read), abs=0.02 * np.ptp(read))


def breathing(part: str) -> Model:
    """A lung on a ventilator; what passes is over a resistance or times a conductance."""

    def equations(m: Scope) -> Equations:
        drive = m.u.pressure - m.x.volume / m.p.compliance
        flow = drive / m.p.resistance if part == "resistance" else drive * m.p.conductance
        return {"volume": flow}, {"flow": flow, "volume": m.x.volume}

    own = {"resistance": ("Pa s/m3", 2e6), "conductance": ("m3/(s Pa)", 5e-7)}
    unit, value = own[part]
    return machine(
        equations,
        "volume m3 scale=5e-4",
        "pressure Pa scale=2e3",
        "flow m3/s scale=1e-3, volume m3 scale=5e-4",
        f"{part} {unit} {value} {0.1 * value} {10.0 * value}, compliance m3/Pa 4e-7",
    )


@pytest.mark.parametrize("part", ["resistance", "conductance"])
def test_a_turbulent_flow_loses_pressure_with_its_square(part: str) -> None:
    model, quadratic = breathing(part), 6e8
    ranges = {argument_of(part): (-1e3, 2e3)}
    law = offered(model, f"turbulent_flow_{part}", ranges=ranges)
    turbulent = model.with_effect(law.at_size(quadratic * 2e3 / 2e6**2, {"largest": 2e3}))
    for volume, pressure in ((0.0, 2e3), (4e-4, 3e2), (2e-4, 5e2)):
        drive = pressure - volume / 4e-7
        (flow,) = turbulent.rates([volume], [pressure])
        assert 2e6 * flow + quadratic * flow * abs(flow) == pytest.approx(drive, abs=1e-3)
        assert turbulent.read([volume], [pressure])[0] == pytest.approx(flow)


def test_what_drives_a_flow_between_two_stores_may_be_turbulent() -> None:
    flow = breathing("resistance")

    def equations(m: Scope) -> Equations:
        through = (m.x.hose - m.x.lung) / m.p.resistance
        return (
            {"hose": 10.0 * (m.u.pressure - m.x.hose), "lung": through / m.p.compliance},
            {"flow": through},
        )

    model = replace(
        flow,
        equations=equations,
        states=(State("hose", "Pa", 1e3), State("lung", "Pa", 1e3)),
        outputs=flow.outputs[:1],
    )
    ranges = {argument_of("resistance"): (-1e3, 2e3)}
    assert "turbulent_flow_resistance" in {
        h.name for h in library(model, RecordedFacts(ranges=ranges))
    }


def test_a_sensor_reads_something_of_an_input() -> None:
    model = breathing("resistance")
    law = offered(model, "sensor_cross_talk_volume_pressure")
    heard = model.with_effect(law.at_size(1e-9))
    assert heard.read([3e-4], [2e3])[1] == pytest.approx(3e-4 + 2e-6)
    assert heard.rates([3e-4], [2e3]) == pytest.approx(model.rates([3e-4], [2e3]))
    # A command that a loop computes from the volume has its noise in it.
    assert law.name not in {h.name for h in library(model, RecordedFacts(held=True))}


def test_a_meter_counts_what_leaks_with_the_root_of_a_pressure() -> None:
    model = breathing("resistance")
    laws = {h.name: h for h in library(model, RecordedFacts(ranges={"pressure": (4e2, 2.5e3)}))}
    law = laws["sensor_cross_talk_flow_pressure"]
    assert {"exponent": 0.5} in law.shapes
    assert {"exponent": 0.5} not in laws["sensor_cross_talk_volume_pressure"].shapes
    counted = model.with_effect(law.at_size(2e-7, {"exponent": 0.5}))
    for pressure, part in ((2.5e3, 1.0), (625.0, 0.5)):
        leak = counted.read([3e-4], [pressure])[0] - model.read([3e-4], [pressure])[0]
        assert leak == pytest.approx(2e-7 * 2.5e3 * part, rel=1e-5)


def test_a_drive_that_is_told_a_speed_loses_its_slack_at_each_reversal() -> None:
    model = bench(lost_motion("valve.command", half_width=0.1), "m/s")
    times = np.arange(0.0, 8.0, 1e-3)
    speed = np.where(np.sin(np.pi * times / 2.0) >= 0.0, 0.5, -0.5)
    y = run(model, lambda t: {"value": float(speed[min(int(t / 1e-3 + 1e-6), 7999)])}, times)
    whole = times > 2.0  # From here on each stroke begins where the slack is taken up.
    place = np.cumsum(y[whole]) * 1e-3
    # Each stroke of 1 loses the slack of 0.2.
    assert np.ptp(place) == pytest.approx(0.8, abs=0.01)
    assert np.max(np.abs(y)) == pytest.approx(0.5, abs=1e-6)
    whole_model = bench(lost_motion("valve.command", half_width=0.0), "m/s")
    assert read(whole_model, value=0.3) == pytest.approx(0.3)


def test_what_a_loop_asks_for_in_proportion_ends_at_a_limit() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        asked = m.p.gain * (m.u.demand - m.x.blade)
        return {"blade": m.x.rate, "rate": (asked - m.x.rate) / m.p.lag}

    drive = machine(
        equations,
        "blade rad, rate rad/s",
        "demand rad -1 1",
        "blade rad display_unit=deg",
        "gain 1/s 2 0.5 5, lag s 0.1 0.02 1",
    )
    # What the lag divides is all that acts on the rate.
    (law,) = (h for h in library(drive) if h.law == "term_saturation")
    assert (law.name, law.ports) == ("term_saturation_gain", ("rate.rate",))
    model = drive.with_effect(law.at_size(1.0, {"limit": 0.05}))
    assert model.parameter("term_saturation_gain.limit").unit == "rad"
    for error, asked in ((0.02, 0.04), (0.3, 0.1), (-0.3, -0.1)):
        rate = model.rates([0.1, 0.03], [0.1 + error])[1]
        assert rate == pytest.approx((asked - 0.03) / 0.1)
    # What is held by friction gives way gradually.
    gently = drive.with_effect(law.at_size(1.0, {"limit": 0.05, "knee": 0.5}))
    rate = gently.rates([0.1, 0.03], [0.15])[1]
    assert rate == pytest.approx((2.0 * 0.05 / math.sqrt(2.0) - 0.03) / 0.1)


def test_what_a_factor_of_a_whole_port_multiplies_has_a_unit() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        pull = m.port("belt.force", m.p.grip * (0.15 * m.u.drum - m.x.belt), unit="N")
        return {"belt": pull / 400.0}

    belt = machine(equations, "belt m/s", "drum rad/s", "belt m/s", "grip N s/m 8000 0 5e4")
    law = offered(belt, "term_saturation")
    limit = belt.with_effect(law.at_size(1.0)).parameter("term_saturation_grip.limit")
    assert same_dimension(limit.unit, "m/s")


def test_an_input_with_a_port_of_its_own_is_interpolated_there_alone() -> None:
    for model, at in ((breathing("resistance"), "pressure_command"), (servo_axis(), "axis_force")):
        found = [h.name for h in library(model) if h.law == "input_interpolation"]
        assert found == [f"input_interpolation_{at}"]


@pytest.mark.parametrize(("low", "offered"), [(-1e3, True), (0.0, False)])
def test_two_gains_of_what_goes_one_way_are_one(low: float, offered: bool) -> None:
    found = library(breathing("resistance"), RecordedFacts(ranges={"pressure.command": (low, 2e3)}))
    assert ("asymmetric_gain_pressure_command" in {h.name for h in found}) == offered


def test_each_term_that_a_medium_may_flow_past_has_a_name_of_its_own() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        drag = m.p.air * np.sqrt(m.x.along**2 + m.x.across**2)
        return {"along": m.u.pull - drag * m.x.along, "across": -drag * m.x.across}

    boat = machine(
        equations,
        "along m/s, across m/s",
        "pull m/s2 -5 5, stream m/s",
        "along m/s, across m/s",
        "air 1/m 0.1 0 1",
    )
    names = [h.name for h in library(boat) if h.law == "moving_medium"]
    assert len(set(names)) == len(names) == 4


@pytest.mark.parametrize("law", ["drive_lag", "sensor_lag"])
def test_a_lag_of_a_few_samples_passes_nothing_at_once(law: str) -> None:
    """A gate of 12 s, sampled every 4 s, is no gate that goes 2 % of its way at once."""
    slow = machine(
        lambda m: {"level": 0.01 * m.u.gate - 0.01 * m.x.level}, "level m", "gate 1 0 1", "level m"
    )
    facts = RecordedFacts(("level",), 4000.0, 4.0)
    (lag,) = (h for h in library(slow, facts) if h.law == law)
    whole = slow.with_effect(lag.at_size(12.0))
    linear = at_rest(whole)
    s = 1j * np.array([0.02, 0.3, 3.0])
    found = transfer_function(linear.A, linear.B, linear.C, linear.D, s)[:, 0, 0]
    exact = 0.01 / (s + 0.01) / (12.0 * s + 1.0)
    np.testing.assert_allclose(np.abs(found), np.abs(exact), rtol=0.05)
