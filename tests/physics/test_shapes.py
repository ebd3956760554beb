"""What a law tries before a fit lies within its own bounds, at whatever plant."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.diagnosis.newcomers import crane, drivetrain, maglev, oscillator, swing, two_carts
from tests.machines import clutch, machine
from workbench.diagnosis.findings import along
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.physics.library import library
from workbench.physics.parameter_laws import along_curve, parameter_curve
from workbench.physics.recorded_facts import RecordedFacts, argument_of
from workbench.physics.survey import Survey
from workbench.plants.arm import arm
from workbench.plants.cascaded_tanks import cascaded_tanks
from workbench.plants.servo_axis import servo_axis
from workbench.simulation import simulate

PLANTS = (
    arm, cascaded_tanks, crane, drivetrain, maglev, oscillator, servo_axis, swing, two_carts,
)  # fmt: skip


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("turns", [0.5, 40.0])
def test_shapes_are_within_bounds(plant: Callable[[], Model], turns: float) -> None:
    model = plant()
    seen = {q.name: (-turns, turns) for q in (*model.states, *model.ports)}
    for hypothesis in library(model, RecordedFacts(duration=10.0, sample_time=0.01, ranges=seen)):
        ends = [(q.lower, q.upper) for q in hypothesis.effect.parameters if q.fitted]
        # What has an end at infinity no refit changes.
        assert np.isfinite(ends).all(), hypothesis.name
        for values in hypothesis.shapes:
            # Attaching is where bounds are checked.
            hypothesis.at_size(hypothesis.typical_size, values)


def test_parameters_bend_over_what_is_measured_and_is_no_law_of_its_own() -> None:
    found = {h.name: h.ports for h in parameter_curve.hypotheses(Survey(maglev()))}
    assert found["parameter_curve_lift_over_current"] == ("speed.rate",)
    # A resistance that changes with its current is a curve over the current, which is no new law.
    assert "parameter_curve_resistance_over_current" not in found
    assert "parameter_curve_resistance_over_gap" in found


def test_a_parameter_bends_over_an_input_where_a_sensor_reads_their_product() -> None:
    stack = machine(
        lambda m: (
            {"loss": (0.05 * m.u.current - m.x.loss) / m.p.tau},
            {"voltage": 1.0 - m.x.loss - m.p.resistance * m.u.current},
        ),
        "loss V",
        "current A 0 50",
        "voltage V",
        "tau s 0.3 0.1 1, resistance ohm 2e-3 0 0.1",
    )
    found = {h.name: h for h in parameter_curve.hypotheses(Survey(stack))}
    # The loss is read too, beside an input.
    over = {"resistance_over_current", "resistance_over_loss", "tau_over_loss"}
    assert set(found) == {f"parameter_curve_{curve}" for curve in over}
    bent = stack.with_effect(found["parameter_curve_resistance_over_current"].at_size(1e-3))
    # A line over the range of the current: as much more above its middle as less below.
    lost = [1.0 - float(bent.read([0.0], [i])[0]) for i in (12.5, 25.0, 37.5)]
    per = np.array(lost) / [12.5, 25.0, 37.5]
    assert per[2] > per[1] > per[0] > 0.0


def test_an_inductance_bends_over_its_flux_where_the_current_is_read() -> None:
    coil = machine(
        lambda m: (
            {"flux": m.u.voltage - m.p.resistance * m.x.flux / m.p.inductance},
            {"current": m.x.flux / m.p.inductance},
        ),
        "flux Wb",
        "voltage V -10 10",
        "current A",
        "inductance H 2 0.2 20, resistance ohm 2 0.1 20",
    )
    found = {h.name: set(h.ports) for h in parameter_curve.hypotheses(Survey(coil))}
    assert found == {"parameter_curve_inductance_over_flux": {"flux.rate", "current.reading"}}


def test_a_second_winding_that_reads_the_rate_of_a_flux_is_no_place_of_its_own() -> None:
    def equations(m: Scope) -> Equations:
        current = m.x.flux / m.p.inductance
        rate = m.u.voltage - m.p.resistance * current
        return {"flux": rate}, {"current": current, "second": m.p.ratio * rate}

    transformer = machine(
        equations,
        "flux Wb",
        "voltage V -10 10",
        "current A, second V",
        "inductance H 2 0.2 20, resistance ohm 2 0.1 20, ratio 1 0.1 0 1",
    )
    found = {h.name: h for h in parameter_curve.hypotheses(Survey(transformer))}
    curve = found["parameter_curve_inductance_over_flux"]
    assert set(curve.ports) == {"flux.rate", "current.reading"}
    bent = transformer.with_effect(curve.at_size(1.0))
    current, second = np.ravel(bent.read([0.5], [3.0]))
    assert second == pytest.approx(0.1 * (3.0 - 2.0 * current)) and current != 0.25


def test_a_growth_bends_over_what_it_feeds_on_in_all_that_it_enters() -> None:
    def equations(m: Scope) -> Equations:
        growth = m.p.fastest * m.x.food / (2.0 + m.x.food) * m.x.cells
        fed, lost = m.u.dilution * (12.0 - m.x.food), m.u.dilution * m.x.cells
        return {"food": fed - 6.0 * growth, "cells": growth - lost}, {
            "food": m.x.food,
            "gas": 4.0 * growth,
        }

    digester = machine(
        equations,
        "food g/l 2, cells g/l 2",
        "dilution 1/s 0 0.5 0.2",
        "food g/l, gas g/l/s",
        "fastest 1/s 0.7 0.1 2",
    )
    ranges = {"food": (0.0, 12.0)}
    found = {h.name: h for h in library(digester, RecordedFacts(ranges=ranges))}
    bent = digester.with_effect(found["parameter_curve_fastest_over_food"].at_size(0.3))
    for food in (1.0, 9.0):
        growth = float(bent.read([food, 2.0], [0.2])[1]) / 4.0
        assert not math.isclose(growth, 0.7 * food / (2.0 + food) * 2.0, rel_tol=0.01)
        rates = np.ravel(bent.rates([food, 2.0], [0.2]))
        assert rates == pytest.approx([0.2 * (12.0 - food) - 6.0 * growth, growth - 0.4])


def test_a_transfer_bends_over_the_flow_that_it_is_in_proportion_to() -> None:
    broth = machine(
        lambda m: {"oxygen": m.p.transfer * m.u.air * (1.0 - m.x.oxygen) - m.p.uptake * m.u.cells},
        "oxygen 1",
        "air m3/s 0 1, cells kg/m3 0 5",
        "oxygen 1",
        "transfer 1/m3 0.3 0 5, uptake m3/(kg s) 0.1 0 1",
    )
    found = {h.name for h in parameter_curve.hypotheses(Survey(broth))}
    assert "parameter_curve_transfer_over_air" in found
    # What is in proportion to an input alone is a curve over that, which is no new law.
    assert "parameter_curve_uptake_over_cells" not in found


@pytest.mark.parametrize("pressed", [True, False])
def test_what_rubs_between_two_bodies_bends_over_their_slip_beside_a_force(pressed: bool) -> None:
    rubbing = clutch(f"{'m' if pressed else 'N m s/rad'} 0.04 0.01 0.2", pressed=pressed)
    found = {h.name for h in parameter_curve.hypotheses(Survey(rubbing))}
    # What has no force to press it is a curve over the slip alone: a law of friction.
    assert ("parameter_curve_radius_over_engine_car" in found) == pressed


@pytest.mark.parametrize("lower", [0.0, -1.0])
def test_a_parameter_that_is_never_negative_falls_towards_zero(lower: float) -> None:
    choke = machine(
        lambda m: {"i": (m.u.v - m.x.i) / m.p.inductance},
        "i A",
        "v V -10 10",
        "i A",
        f"inductance H 0.1 {lower} 1",
    )
    (curve,) = parameter_curve.hypotheses(Survey(choke, RecordedFacts(ranges={"i": (-10.0, 10.0)})))
    iron = choke.with_effect(curve.at_size(-0.4, {"bend": 0.5 * math.pi}))
    currents = np.array([0.0, 2.5, 4.0, 10.0])
    found = [5.0 / float(iron.rates([i], [5.0 + i])[0]) for i in currents]
    change = -0.4 * ((currents / 10) ** 2 - 1.0)
    exact = 0.1 * np.exp(change / 0.1) if lower == 0.0 else 0.1 + change
    np.testing.assert_allclose(found, exact, rtol=1e-9)


def cell() -> Model:
    """A cell whose current charges it, and meets a resistance."""
    return machine(
        lambda m: (
            {"charge": -m.u.current / m.p.capacity},
            {"voltage": m.x.charge - m.p.resistance * m.u.current},
        ),
        "charge 1 0.5",
        "current A -5 5",
        "voltage V",
        "capacity A s 1e4 1000 1e5, resistance Ohm 0.02 0 1",
    )


def test_what_is_lost_one_way_is_offered_where_an_input_fills_a_store() -> None:
    whole = cell()
    law = {h.name: h for h in library(whole)}["asymmetric_gain_charge_rate"]
    lossy = whole.with_effect(law.at_size(-0.1))
    rates = [float(lossy.rates([0.5], [i])[0]) / float(whole.rates([0.5], [i])[0]) for i in (-4, 4)]
    assert rates == pytest.approx([0.95, 1.05], rel=1e-3)
    lossy = whole.with_effect(law.at_size(-0.1, {"share": 1.0}))
    rates = [float(lossy.rates([0.5], [i])[0]) / float(whole.rates([0.5], [i])[0]) for i in (-4, 4)]
    assert rates == pytest.approx([0.9, 1.0], rel=1e-3)


def test_a_parameter_may_go_with_a_power_of_what_is_never_negative() -> None:
    pot = machine(
        lambda m: ({"warm": m.u.heat - m.p.film * m.u.flow * m.x.warm}, {"warm": m.x.warm}),
        "warm K",
        "heat K/s 0 10, flow kg/s 0 2 1",
        "warm K",
        "film 1/kg 0.5 0 5",
    ).opened()
    seen = {"flow": (0.2, 1.0), "heat": (1.0, 8.0), "warm": (-1.0, 9.0)}
    found = {h.name: h for h in library(pot, RecordedFacts(ranges=seen)) if "power" in h.law}
    # What has either sign has no power, and what is next to constant has none that shows.
    assert "parameter_power_film_over_warm" not in found
    law = found["parameter_power_film_over_flow"]
    bent = pot.with_effect(law.at_size(0.8))
    for flow in (0.2, 0.6, 1.0):
        # A fifth of the middle's flow, 0.6 kg/s, and so on.
        lost = [-float(m.rates([4.0], [0.0, flow])[0]) for m in (bent, pot)]
        assert lost[0] == pytest.approx(lost[1] * (flow / 0.6) ** 0.8)
    assert list(along_curve(bent, bent.effects[0]).values())[1] == pytest.approx(0.5)
    still = library(pot, RecordedFacts(ranges=seen | {"flow": (0.9, 1.0)}))
    assert "parameter_power_film_over_flow" not in {h.name for h in still}


def test_a_parameter_may_be_halved_by_what_stands_in_its_way() -> None:
    culture = machine(
        lambda m: ({"food": m.u.feed - m.p.uptake * m.x.food}, {"food": m.x.food}),
        "food g/l 1 0 inf",
        "feed g/(l h) 0 1",
        "food g/l",
        "uptake 1/h 0.5 0 5",
    )
    seen = RecordedFacts(ranges={"food": (0.2, 3.8), "feed": (0.0, 1.0)})
    laws = (h for h in library(culture, seen) if h.law == "parameter_hill")
    assert {h.name for h in laws} == set()  # Of a bare signal other laws are curves.
    fed = machine(
        lambda m: (
            {"food": m.u.feed - m.p.uptake * m.x.food * m.x.cells, "cells": -0.1 * m.x.cells},
            {"food": m.x.food, "cells": m.x.cells},
        ),
        "food g/l 1 0 inf, cells g/l 2 0 inf",
        "feed g/(l h) 0 1",
        "food g/l, cells g/l",
        "uptake l/(g h) 0.5 0 5",
    )
    (law,) = (h for h in library(fed, seen) if h.name == "parameter_hill_uptake_over_food")
    # Monod: uptake k / (k + food), k = 4 g/l, is 1 / 1.5 of it at the middle of the range, 2 g/l.
    slowed = fed.with_effect(law.at_size(0.5, {"exponent": -1.0}))
    for food in (0.5, 2.0, 3.5):
        taken = [-float(m.rates([food, 2.0], [0.0])[0]) for m in (slowed, fed)]
        assert taken[0] == pytest.approx(taken[1] * 4.0 / (4.0 + food))
    assert list(along_curve(slowed, slowed.effects[0]).values())[1] * 1.5 == pytest.approx(
        fed.parameter("uptake").value
    )


def test_what_a_sensor_reads_bends_over_a_charge_that_none_reads_alone() -> None:
    cell = machine(
        lambda m: (
            {"charge": -m.u.current, "lag": m.u.current - m.x.lag},
            {"volts": m.p.rest + m.x.charge - m.x.lag - m.p.loss * m.u.current},
        ),
        "charge 1 0.9 0 1, lag V",
        "current A",
        "volts V",
        "rest V 3 2 4, loss ohm 0.1 0 1",
    )
    found = {h.name for h in library(cell) if h.law == "parameter_curve"}
    assert {f"parameter_curve_{q}_over_charge" for q in ("rest", "loss")} <= found


def test_a_parameter_of_several_stores_may_go_with_the_level_of_each() -> None:
    ram = machine(
        lambda m: {
            "speed": (m.x.head - m.x.rod) / 1e6,
            "head": m.p.modulus * (m.u.flow - m.x.speed),
            "rod": m.p.modulus * (m.x.speed - 1e-6 * m.x.rod),
        },
        "speed m/s, head Pa 2e6 0 inf, rod Pa 2e6 0 inf",
        "flow m/s",
        "head Pa, rod Pa",
        "modulus Pa/m 1e9 1e8 5e9",
    )
    seen = RecordedFacts(ranges={"head": (1e6, 9e6), "rod": (5e5, 5e6)})
    (law,) = (h for h in library(ram, seen) if h.name == "parameter_power_modulus_over_each_head")
    stiff = ram.with_effect(law.at_size(1.0))
    # The middle of all that was seen of both is 4.75e6 Pa.
    assert stiff.rates([0.5, 9.5e6, 4.75e6], [0.0])[1:] == pytest.approx(
        ram.rates([0.5, 9.5e6, 4.75e6], [0.0])[1:] * [2.0, 1.0]
    )
    assert along(stiff, stiff.effects[0]).endswith(
        "of head, and so by what each other port changes"
    )


def test_what_pushes_does_not_pull() -> None:
    cam = machine(
        lambda m: ({"v": m.p.stiff * (m.u.lift - m.x.place), "place": m.x.v}, {"place": m.x.place}),
        "v m/s, place m",
        "lift m",
        "place m",
        "stiff 1/s2 100 1 1e3",
    )
    seen = {"lift": (0.0, 1.0), "place": (-1.0, 1.0), argument_of("stiff"): (-1.0, 1.0)}
    (law,) = (h for h in library(cam, RecordedFacts(ranges=seen)) if h.law == "term_slack")
    for sense in (1.0, -1.0):
        loose = cam.with_effect(law.at_size(1.0, {"holds": 0.2, "sense": sense}))
        for pushed in (-0.9, -0.3, -0.1, 0.0, 0.1, 0.3, 0.9):
            force = loose.rates([0.0, -pushed], [0.0])[0]
            assert force == pytest.approx(100.0 * sense * max(sense * pushed, -0.2))


def test_limits_are_tried_within_what_was_seen() -> None:
    bath = machine(
        lambda m: ({"warm": m.p.k * (m.u.room - m.x.warm)}, {"warm": m.x.warm}),
        "warm K 290",
        "room K scale=5",
        "warm K",
        "k 1/s 1 0 9",
    )
    found = library(bath, RecordedFacts(ranges={"room.command": (288.0, 298.0)}))
    (limit,) = (h for h in found if h.name == "lower_saturation_room_command")
    assert all(288.0 < shape["limit"] < 298.0 for shape in limit.shapes)


def test_a_second_store_takes_what_the_first_one_loses_until_both_are_level() -> None:
    blood = machine(
        lambda m: {"level": m.u.dose}, "level kg/m3", "dose kg/(m3 s) 0 1", "level kg/m3"
    )
    law = {h.name: h for h in library(blood, RecordedFacts(duration=10.0, sample_time=0.1))}[
        "second_store_level"
    ]
    model = blood.with_effect(law.at_size(0.4, {"time_constant": 5.0}))
    times = np.linspace(0.0, 30.0, 301)
    start = {"level": 3.0, "second_store_level.beside": 0.0}
    run = simulate(model, np.zeros(len(times)), sample_time=0.1, start=start)
    # What leaves the first, 0.4 (a - b), fills the second, half as large: (a - b) / 5 s.
    exact = 1.0 + 2.0 * np.exp(-0.6 * times)
    np.testing.assert_allclose(run.outputs[:, 0], exact, rtol=1e-5)


def test_a_slow_response_goes_on_where_an_input_is_read_at_once() -> None:
    found = {h.name: h for h in library(cell(), RecordedFacts(duration=100.0, sample_time=1.0))}
    law = found["slow_response_voltage_current"]
    times = np.linspace(0.0, 100.0, 101)
    slow, none = (
        simulate(
            cell().with_effect(law.at_size(size, {"time_constant": 20.0})),
            np.full(len(times), 3.0),
            sample_time=1.0,
        ).outputs[:, 0]
        for size in (-0.01, 0.0)
    )
    np.testing.assert_allclose(slow - none, -0.03 * (1.0 - np.exp(-times / 20.0)), atol=1e-7)


def test_a_parameter_that_enters_several_ports_may_fade_in_all_of_them() -> None:
    # Scale on the wall of a heat exchanger: one coefficient, in the balances of all that it parts.
    def equations(m: Scope) -> Equations:
        hot, cold, wall = m.x.hot, m.x.cold, m.x.wall
        return {
            "hot": m.u.flow * (350.0 - hot) - m.p.UA * (hot - wall),
            "cold": 0.1 * (290.0 - cold) + m.p.UA * (wall - cold),
            "wall": 5.0 * m.p.UA * (hot - 2.0 * wall + cold),
        }, {"out": cold}

    model = machine(
        equations,
        ", ".join(f"{name} K 300 scale=20" for name in ("hot", "cold", "wall")),
        "flow 1/s scale=0.1",
        "out K 0.1 scale=20",
        "UA 1/s 0.1 0.01 1",
    )
    found = {h.name: h.ports for h in library(model)}
    assert {"parameter_fade_UA", "parameter_jump_UA"} <= found.keys()
    assert set(found["parameter_fade_UA"]) == {"hot.rate", "cold.rate", "wall.rate"}


def test_a_parameter_bends_over_inputs_that_nobody_uses_or_that_carry_something() -> None:
    tank = machine(
        lambda m: {
            "T": (m.u.flow * (m.u.feed - m.x.T) - m.p.loss * (m.x.T - 290.0) + m.u.heat) / 50.0
        },
        "T K 290",
        "flow m3/s, feed K, heat W, wind m/s",
        "T K",
        "loss W/K 2 0 10",
    )
    found = {h.name for h in parameter_curve.hypotheses(Survey(tank))}
    assert found == {"parameter_curve_loss_over_flow", "parameter_curve_loss_over_wind"}


def test_what_passes_carries_neither_a_place_nor_a_speed() -> None:
    heater = machine(
        lambda m: (
            {"place": m.x.speed, "speed": -m.x.speed, "warm": m.u.flow * (300.0 - m.x.warm)},
            {"place": m.x.place, "speed": m.x.speed, "warm": m.x.warm},
        ),
        "place m, speed m/s, warm K 290",
        "flow m3/s 0 1",
        "place m, speed m/s, warm K",
    )
    seen = RecordedFacts(ranges={"flow": (0.2, 0.9)})
    found = {e.name for e in library(heater, seen) if e.law == "sensor_distance"}
    assert found == {"sensor_distance_warm_flow"}
    steady = RecordedFacts(ranges={"flow": (0.8, 0.9)})
    assert not [e for e in library(heater, steady) if e.law == "sensor_distance"]


@pytest.mark.parametrize(
    ("plant", "unit"), [(servo_axis, "rad/m"), (oscillator, "rad/m"), (arm, "1")]
)
def test_a_ripple_counts_radians_of_its_wave(plant: Callable[[], Model], unit: str) -> None:
    (law,) = (h for h in library(plant()) if h.name == "ripple")
    (frequency,) = (q for q in law.effect.parameters if q.name == "frequency")
    assert frequency.unit == unit
