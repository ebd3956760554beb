"""A plant that declares no size, in any unit and at any pace, gives the same answers."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import control as ct
import numpy as np
import pytest

from controllers.plain.mpc import PlainMPCSpecification, design_plain_mpc
from controllers.plain.pid_design import PlainPIDSpecification, design_plain_pid
from controllers.plain.state_feedback import LQISpecification, design_lqi
from controllers.sensitivity import peak_sensitivities
from tests.machines import at_rest, machine
from workbench.diagnosis.location.isolability import transfers
from workbench.diagnosis.location.structure import cut
from workbench.errors import WorkbenchError
from workbench.linearisation import linear_model, linearise
from workbench.linearisation.time_scales import step_time
from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.quantities import shown_in
from workbench.model.trace import Equations
from workbench.operating_point import operating_point
from workbench.physics.library import library
from workbench.study.margins import analyse_loop
from workbench.verification import metrics, step_scenario, verify
from workbench.verification.metrics import metric_sizes, tolerance_of

UNITS = [
    pytest.param(1e-7, 1.0, 1.0, id="microseconds"),
    pytest.param(1e6, 1e4, 1e-3, id="weeks"),
    pytest.param(1e-4, 1e-9, 100.0, id="nanometres"),
]


def stage(pace: float, length: float, voltage: float, sized: bool = False) -> Model:
    """A stage on a hardening spring behind a lag, in other units of time, length and voltage."""

    def equations(m: Scope) -> Equations:
        force = m.p.gain * m.x.drive - m.p.k * m.x.x - m.p.k3 * m.x.x**3 - m.p.d * m.x.v
        rates = {"x": m.x.v, "v": force, "drive": (m.u.u - m.x.drive) / m.p.tau}
        return rates, {"position": m.x.x}

    def size(value: float) -> float:
        return value if sized else 0.0

    return Model(
        "stage",
        equations,
        states=(
            State("x", "m", size(length)),
            State("v", "m/s", size(length / pace)),
            State("drive", "V", size(voltage)),
        ),
        inputs=(Input("u", "V", size(voltage), lower=-2.0 * voltage, upper=2.0 * voltage),),
        outputs=(Output("position", "m", size(length)),),
        parameters=(
            Parameter("gain", "m/(s2 V)", value=length / pace**2 / voltage),
            Parameter("k", "1/s2", value=1.0 / pace**2),
            Parameter("k3", "1/(m2 s2)", value=0.3 / (pace * length) ** 2),
            Parameter("d", "1/s", value=0.5 / pace),
            Parameter("tau", "s", value=0.2 * pace),
        ),
    )


@pytest.mark.parametrize(("pace", "length", "voltage"), UNITS)
def test_sizes_follow_the_units(pace: float, length: float, voltage: float) -> None:
    usual, other = stage(1.0, 1.0, 1.0), stage(pace, length, voltage)
    of_states = np.array([q.scale for q in other.states]) / [length, length / pace, voltage]
    assert of_states == pytest.approx([q.scale for q in usual.states], rel=1e-6)
    # As large as the statics say: 2 V bring 2 m / (1 + 0.3 x^2), some 1.3 m at the most.
    assert 0.3 < usual.states[0].scale < 2.0 and usual.inputs[0].scale == 2.0
    ports = {q.name: q.scale for q in other.ports}
    known = {q.name: q.scale for q in usual.ports}
    assert ports["v.rate"] == pytest.approx(known["v.rate"] * length / pace**2, rel=1e-6)
    assert not any(q.sized for q in (*other.states, *other.outputs))
    declared = stage(pace, length, voltage, sized=True)
    assert declared.states[0].scale == length and declared.states[0].sized


@pytest.mark.parametrize("sized", [True, False], ids=["sized", "unsized"])
@pytest.mark.parametrize(("pace", "length", "voltage"), UNITS)
def test_points_and_poles_follow_the_units(
    pace: float, length: float, voltage: float, sized: bool
) -> None:
    point = operating_point(stage(pace, length, voltage, sized), {"position": 0.5 * length})
    assert point["x"] == pytest.approx(0.5 * length, rel=1e-9)
    # k x + k3 x^3 = 0.5 + 0.3 0.125.
    assert point.u[0] == pytest.approx(0.5375 * voltage, rel=1e-6)
    linear = linearise(point)
    usual = linearise(operating_point(stage(1.0, 1.0, 1.0, sized), {"position": 0.5}))
    assert np.sort_complex(linear.poles * pace) == pytest.approx(np.sort_complex(usual.poles))
    assert step_time(linear) == pytest.approx(step_time(usual) * pace)
    found, expected = (
        (m.verdict.amplitude.upper / v, m.verdict.frequency.upper * t)
        for m, v, t in ((linear, voltage, pace), (usual, 1.0, 1.0))
    )
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(("pace", "length", "voltage"), UNITS)
def test_loops_follow_the_units(pace: float, length: float, voltage: float) -> None:
    def scored(t: float, x: float, v: float) -> list[list[float]]:
        plant = stage(t, x, v)
        linear = at_rest(plant, position=0.0)
        h = step_time(linear) / 1000
        rows = []
        for law in (
            design_plain_pid(linear, PlainPIDSpecification(sample_time=h)),
            design_lqi(linear, LQISpecification(sample_time=h)),
            design_plain_mpc(linear, PlainMPCSpecification(sample_time=h)),
        ):
            scenario = step_scenario("position", 0.0, 0.4 * x, lead=t, hold=20.0 * t, sample_time=h)
            told = metrics(verify(law, plant, scenario))
            opened = analyse_loop(law, linear)[0]
            assert not opened.reason
            rows.append(
                [
                    *peak_sensitivities(law, linear),
                    told["rmse"].value / x,
                    opened.delay_margin / t,
                ]
            )
        return rows

    # Two runs of the integrator with other steps agree within its tolerance.
    assert np.array(scored(pace, length, voltage)) == pytest.approx(
        np.array(scored(1.0, 1.0, 1.0)), rel=1e-4
    )


@pytest.mark.parametrize(("pace", "length", "voltage"), UNITS)
def test_what_ports_do_to_measurements_follows_the_units(
    pace: float, length: float, voltage: float
) -> None:
    found, usual = (
        transfers(cut(stage(*units)), ("position",)).measurements
        for units in ((pace, length, voltage), (1.0, 1.0, 1.0))
    )
    assert np.abs(usual).max() > 0.0
    assert found == pytest.approx(usual, rel=1e-6)


@pytest.mark.parametrize(("pace", "length", "voltage"), UNITS)
def test_what_does_not_count_in_a_comparison_follows_the_units(
    pace: float, length: float, voltage: float
) -> None:
    def absolute(t: float, x: float, v: float) -> dict[str, float]:
        sizes = metric_sizes(stage(t, x, v), ("position",), 0.01 * t)
        units = {"settling_time": t, "rmse": x, "iae": x * t, "chatter": v / t, "command_lowest": v}
        return {n: tolerance_of(n).sized(sizes[n]).absolute / u for n, u in units.items()}

    assert absolute(pace, length, voltage) == pytest.approx(absolute(1.0, 1.0, 1.0), rel=1e-6)


@functools.cache
def rates_of_laws(t: float, x: float, v: float, shape: str) -> dict[str, list[float]]:
    """What the laws of the library do to a stage, in its units of time, length and voltage."""
    plant, found = stage(t, x, v), {}
    sizes = np.array([x, x / t, v])
    # The pitches of screws on which a ripple is tried are those that one can buy.
    for law in (h for h in library(plant) if h.law != "ripple"):
        own = {"usual": {}, "first": law.shapes[0], "last": law.shapes[-1]}[shape]
        with_law = plant.with_effect(law.at_size(law.typical_size, own))
        for at, form in itertools.product(
            ([0.3, -0.2, 0.7], [-1.0, 1e-3, 1.5]), ("exact", "regularised")
        ):
            state = with_law.initial_state(
                {n: a * s for n, a, s in zip(("x", "v", "drive"), at, sizes, strict=True)}
            )
            moved = with_law.rates(state, [0.9 * v], form=form)[:3] * t / sizes
            read = with_law.read(state, [0.9 * v], form=form) / x
            found[f"{law.name} at {at}, {form}"] = [*moved, *read]
    return found


@pytest.mark.parametrize(
    "shape", ["usual", *(pytest.param(s, marks=pytest.mark.long) for s in ("first", "last"))]
)
@pytest.mark.parametrize(("pace", "length", "voltage"), UNITS)
def test_every_law_of_the_library_follows_the_units(
    pace: float, length: float, voltage: float, shape: str
) -> None:
    usual, other = (rates_of_laws(*u, shape) for u in ((1.0, 1.0, 1.0), (pace, length, voltage)))
    assert len(usual) > 40 and set(usual) == set(other)
    for name, values in usual.items():
        assert other[name] == pytest.approx(values, rel=1e-6, abs=1e-9), name


@pytest.mark.parametrize(
    "sign",
    [lambda v: ca.tanh(v / 1e-3), lambda v: v / (ca.fabs(v) + 1e-3)],
    ids=["at once", "ever less"],
)
def test_a_bearing_that_sticks_at_the_start_is_sized_where_it_slides(
    sign: Callable[[ca.SX], ca.SX],
) -> None:
    made = machine(
        lambda m: ({"v": m.u.force - 0.2 * sign(m.x.v) - 0.5 * m.x.v}, {"speed": m.x.v}),
        "v m/s",
        "force N -1 1",
        "speed m/s",
    )
    # 1 N against 0.5 N s/m; stuck it would creep at 1 / (0.2 / 1e-3) = 5 mm/s.
    assert 0.5 < made.states[0].scale < 2.5
    assert math.isclose(made.outputs[0].scale, made.states[0].scale)


@pytest.mark.parametrize("end", [math.inf, 0.6], ids=["nothing declared", "declared"])
def test_equations_that_clip_an_input_tell_how_far_it_moves_a_plant(end: float) -> None:
    def ship(m: Scope) -> dict[str, Any]:
        steering = ca.fmin(ca.fmax((m.u.rudder - m.x.rudder) / 2.0, -0.04), 0.04)
        turning = (0.05 * m.x.rudder - m.x.rate - 2000.0 * m.x.rate**3) / 20.0
        return {"heading": m.x.rate, "rate": turning, "rudder": steering}

    made = machine(
        ship, "heading rad, rate rad/s, rudder rad", f"rudder rad {-end} {end}", "heading rad"
    )
    # 0.05 of a rudder of 0.08 rad, or of the declared one; at 1 rad/s it would stop in 13 ms.
    assert 0.001 < made.states[1].scale < 0.05 * min(end, 0.5)
    assert abs(at_rest(made).mode_of("rate").pole) < 0.2


def test_an_unstable_oscillation_gives_no_size_of_its_own() -> None:
    # Poles at growth + j, of which 1 + j is where responses are taken.
    def scale(growth: float) -> float:
        def equations(m: Scope) -> dict[str, Any]:
            return {"x": growth * m.x.x + m.x.y + m.u.u, "y": growth * m.x.y - m.x.x}

        spiral = machine(equations, "x m, y m", "u m/s -1 1", "x m")
        return max(q.scale for q in spiral.states)

    assert max(scale(g) for g in (0.5, 0.9, 1.0, 1.1)) < 4.0


@pytest.mark.parametrize("integrates", [False, True])
def test_the_unit_of_an_output_is_none_of_the_others(integrates: bool) -> None:
    def scales(*units: float) -> list[float]:
        A, B = np.array([[-1.0, 0.3], [0.2, -2.0]]), np.array([[1.0, 0.2], [0.0, 1.0]])
        A[0, 0] *= not integrates
        A[0, 1] *= not integrates
        A[1, 0] *= not integrates
        system = ct.ss(A, B, np.diag(units), np.zeros((2, 2)), outputs=["p", "q"])
        return [q.scale for q in linear_model(system, limits=3.0).operating_point.model.outputs]

    p, q = scales(1.0, 1.0)
    # What integrates goes anywhere: by its unit at most.
    goes = 1.0 if integrates else 1e5 * p
    assert scales(1e5, 1e-3) == pytest.approx([goes, 1e-3 * q]) and (p == 1.0) == integrates


def test_what_is_no_number_in_a_linear_system_is_said() -> None:
    for system, said in (
        (ct.ss([[-1.0, math.nan], [0, -1]], [[0], [1]], [[1, 0]], 0), "matrix A .* index 1"),
        (ct.tf([1.0], [1.0, math.nan]), "the denominator .* index 1"),
    ):
        with pytest.raises(WorkbenchError, match=said):
            linear_model(system)


def crane() -> Model:
    """A trolley with a load on a rope that a winch pulls: nothing but its drives ends a motion."""

    def equations(m: Scope) -> Equations:
        swing, rate, rope = m.x.swing, m.x.rate, m.x.rope
        push = (m.u.drive - 100.0 * m.x.speed + m.u.winch * ca.sin(swing)) / 200.0
        fall = 9.81 * ca.cos(swing) + rope * rate**2 - push * ca.sin(swing)
        swung = -(9.81 * ca.sin(swing) + 2.0 * m.x.hoist * rate + push * ca.cos(swing)) / rope
        rates = {
            "place": m.x.speed,
            "speed": push,
            "swing": rate,
            "rate": swung,
            "rope": m.x.hoist,
            "hoist": fall - (m.u.winch + 300.0 * m.x.hoist) / 120.0,
        }
        return rates, {"place": m.x.place, "swing": swing}

    return machine(
        equations,
        "place m, speed m/s, swing rad, rate rad/s, rope m 4, hoist m/s",
        "drive N -900 900, winch N 0 2500 1177.2",
        "place m display_unit=mm, swing rad display_unit=deg",
    )


def test_sizes_that_lead_ever_further_are_not_followed() -> None:
    # A longer rope swings slower, and slower is what moves the trolley far: without end.
    size = {q.name: q.scale for q in crane().states}
    assert size["swing"] < 2.0
    assert size["place"] < 50.0 and size["rope"] < 50.0


def test_a_curve_that_saturates_shows_no_more_than_from_end_to_end() -> None:
    def effect(m: Scope) -> Equations:
        strength = m.x.dose**2 / (m.x.dose**2 + 16.0)
        return {"dose": m.u.rate - 0.1 * m.x.dose}, {"awake": 95.0 * (1.0 - strength)}

    drug = machine(effect, "dose 1 4", "rate 1/s 0 60", "awake 1")
    # Of a dose of up to 600, where all sleep, the slope is 0.01 % of that at rest.
    assert 20.0 < drug.outputs[0].scale < 95.0


def test_a_state_is_read_in_the_unit_of_the_output_of_its_name() -> None:
    shown = {q.name: shown_in(q) for q in crane().states}
    assert shown == {
        "place": "mm", "speed": "m/s", "swing": "deg", "rate": "rad/s", "rope": "m", "hoist": "m/s",
    }  # fmt: skip


def test_a_lake_that_seems_empty_is_as_deep_as_its_gauge_says() -> None:
    def equations(m: Scope) -> Equations:
        outflow = 4.0 * m.u.gate * m.x.level**1.5
        return {"level": (m.u.inflow - outflow) / 2e5}, {"gauge": m.x.level}

    lake = machine(equations, "level m", "inflow m3/s, gate 1 0 1", "gauge m")
    # At its empty start nothing flows out, and nothing tells how high it will stand.
    assert lake.sized_by({"inflow": 10.0}).states[0].scale < 1e-3
    seen = lake.sized_by({"inflow": 10.0, "gauge": 1.2})
    assert seen.states[0].scale == seen.outputs[0].scale == 1.2
    assert lake.sized_by({"inflow": 10.0, "gauge": 1e-4}) == lake.sized_by({"inflow": 10.0})


def test_what_grows_is_not_waited_for_where_drag_slows_its_growth() -> None:
    """A boat that its own compression sinks, by a pump, against the square of its speed."""

    def equations(m: Scope) -> dict[str, Any]:
        drag = 0.05 * m.x.w * np.abs(m.x.w) + 0.002 * m.x.w
        heavy = 5e-5 * (m.x.ballast + 0.5 * (m.x.depth - 50.0))
        return {"depth": m.x.w, "w": heavy - drag, "ballast": m.u.pump}

    boat = machine(equations, "depth m 50, w m/s, ballast kg", "pump kg/s -20 20", "depth m")
    # 20 kg/s in the time of its growth, 250 s, sink it at about 2 m/s: (0.25 / 0.05)^0.5.
    depth, speed, _ = boat.states
    assert 1.0 < speed.scale < 4.0
    assert 100.0 < depth.scale < 1000.0
