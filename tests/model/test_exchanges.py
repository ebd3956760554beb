"""What states give one another, found in equations that know nothing of ports."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from tests.diagnosis.newcomers import crane, drivetrain
from tests.machines import machine
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.physics.library import library
from workbench.physics.offset_gain import gain
from workbench.physics.recorded_facts import RecordedFacts, argument_of
from workbench.physics.survey import Survey


def tanks(*, shared: bool = False) -> Model:
    """Two open tanks of different areas, joined by a pipe, and by a pump that fills both."""

    def equations(m: Scope) -> Equations:
        flow = (m.x.left - m.x.right) / m.p.resistance
        filled = m.p.pump * m.u.speed
        second = filled if shared else 0.0
        return (
            {"left": (filled - flow) / 2.0, "right": (flow + second) / 5.0},
            {"level": m.x.right},
        )

    return machine(
        equations,
        "left m 1, right m 0.5",
        "speed rad/s",
        "level m",
        "resistance s/m2 4 0.1 inf, pump m3/rad 1e-3 0 inf",
    )


def ports(model: Model) -> list[str]:
    return [q.name for q in model.ports if q.name.endswith(".exchange")]


def test_a_pipe_gives_to_one_tank_what_it_takes_from_the_other() -> None:
    model = tanks()
    assert ports(model) == ["left_right.exchange"]
    at = [1.0, 0.5], [0.0]
    # A parameter below a line enters with the power -1: the value is the flow all the same.
    assert model.signals(*at)["left_right.exchange"] == pytest.approx(-0.5 / 4.0 / 2.0)
    assert model.rates(*at) == pytest.approx([-0.0625, 0.025])
    doubled = model.with_effect(gain("left_right.exchange", excess=1.0))
    assert doubled.rates(*at) == pytest.approx([-0.125, 0.05])


def test_one_conductivity_passes_heat_between_every_two_nodes_of_a_rod() -> None:
    def equations(m: Scope) -> dict[str, object]:
        first, last = m.p.k * (m.x.a - m.x.b), m.p.k * (m.x.b - m.x.c)
        return {
            "a": (m.u.heat - first) / m.p.c,
            "b": (first - last) / m.p.c,
            "c": (last - m.p.h * m.x.c) / (2.0 * m.p.c),
        }

    rod = machine(
        equations,
        "a K 30, b K 20, c K 10",
        "heat W",
        "a K",
        "k W/K 2 0 9, c J/K 5 1 9, h W/K 1 0 9",
    )
    assert ports(rod) == ["a_b.exchange", "b_c.exchange"]
    still = rod.rates([30.0, 20.0, 10.0], [0.0])
    doubled = rod.with_effect(gain("b_c.exchange", excess=1.0))
    # 20 W more from b to c, which holds twice as much.
    assert doubled.rates([30.0, 20.0, 10.0], [0.0]) - still == pytest.approx([0.0, -4.0, 2.0])
    assert [q.name for q in Survey(rod).passing(rod.parameter("k"))] == ports(rod)
    assert Survey(rod).passing(rod.parameter("h")) == ()
    # Of what is written as a whole nothing can be told apart.
    whole = machine(
        lambda m: {
            "a": m.p.k * (m.x.b - m.x.a),
            "b": m.p.k * (m.x.a - 2.0 * m.x.b + m.x.c),
            "c": m.p.k * (m.x.b - m.x.c),
        },
        "a K 30, b K 20, c K 10",
        "heat W",
        "a K",
        "k 1/s 2 0 9",
    )
    assert ports(whole) == []


def test_what_fills_both_is_no_exchange() -> None:
    assert ports(tanks(shared=True)) == ["left_right.exchange"]
    # The force on a crane's trolley moves the load in a ratio that turns with the rope.
    assert ports(crane()) == []


def test_a_hose_gives_a_lung_what_leaves_its_own_pressure() -> None:
    """A pressure and a volume share what one resistance lets pass, read as the volume's flow."""

    def equations(m: Scope) -> Equations:
        flow = (m.x.hose - m.x.volume / m.p.compliance) / m.p.airway
        supplied = (m.u.blower - m.x.hose) / m.p.line
        return {"hose": (supplied - flow) / 2e-8, "volume": flow}, {"flow": flow}

    lung = machine(
        equations,
        "hose Pa 500, volume m3 5e-4",
        "blower Pa",
        "flow m3/s",
        "compliance m3/Pa 5e-7, airway Pa*s/m3 1e6, line Pa*s/m3 4e5",
    )
    assert ports(lung) == ["volume_hose.exchange"]
    at = [800.0, 2.5e-4], [1000.0]
    assert lung.signals(*at)["volume_hose.exchange"] == pytest.approx(3e-4)
    doubled = lung.with_effect(gain("volume_hose.exchange", excess=1.0))
    assert doubled.rates(*at) - lung.rates(*at) == pytest.approx([-3e-4 / 2e-8, 3e-4])
    assert doubled.signals(*at)["flow.reading"] == pytest.approx(6e-4)


def test_a_reaction_takes_a_substance_and_warms_what_holds_it() -> None:
    """It has no rate near 0 K, and what boils off takes mass and warmth with it."""

    def equations(m: Scope) -> Equations:
        reacted = m.p.often * ca.exp(-8750.0 / m.x.warm) * m.x.left
        boiled = m.p.boiling * (m.x.warm - 290.0)
        return (
            {
                "left": -reacted,
                "mass": -boiled,
                "warm": 0.2 * reacted - 110.0 * boiled + m.u.heat / 4e5,
            },
            {"warm": m.x.warm},
        )

    reactor = machine(
        equations,
        "left mol/m3 500, mass kg 100, warm K 350",
        "heat W",
        "warm K",
        "often 1/s 1e9 1e8 1e10, boiling kg/(K*s) 1e-5 0 1e-3",
    )
    assert ports(reactor) == ["left_warm.exchange", "mass_warm.exchange"]
    at = [500.0, 100.0, 350.0], [0.0]
    more = reactor.with_effect(gain("left_warm.exchange", excess=1.0)).rates(*at)
    reacted = 500.0 * 1e9 * np.exp(-25.0)
    assert more - reactor.rates(*at) == pytest.approx([-reacted, 0.0, 0.2 * reacted])


def test_what_two_kinds_of_states_share_by_chance_is_no_exchange() -> None:
    def motor(m: Scope) -> Equations:
        emf, torque = m.p.k * m.x.speed, m.p.k * m.x.current
        return (
            {
                "current": (m.u.voltage - m.p.R * m.x.current - emf) / 1e-3,
                "speed": (torque - 1e-4 * m.x.speed) / 1e-5,
            },
            {"speed": m.x.speed},
        )

    # One factor, two terms; and what an input alone gives acts at its command.
    direct = machine(
        motor, "current A 1, speed rad/s 10", "voltage V", "speed rad/s", "k V*s 0.05, R ohm 1"
    )
    charged = machine(
        lambda m: (
            {"charge": -m.p.gain * m.u.current, "drop": m.p.gain * m.u.current - m.x.drop},
            {"drop": m.x.drop},
        ),
        "charge C 1, drop V 1", "current A", "drop V", "gain 1 2",
    )  # fmt: skip
    assert ports(direct) == ports(charged) == []


def test_a_coupling_is_one_force_with_all_its_parts() -> None:
    model = drivetrain()
    assert ports(model) == ["motor_speed_load_speed.exchange"]
    x = np.array([0.3, 0.1, 2.0, 1.5])
    given = model.signals(x, [0.0])["motor_speed_load_speed.exchange"]
    assert given == pytest.approx(-(40.0 * 0.2 + 0.05 * 0.5) / 0.01)
    place = Survey(model).place("motor_speed_load_speed.exchange")
    assert place.role == "acceleration"
    assert (place.speed.source, place.speed.minus) == ("motor_speed", "load_speed")
    assert (place.coordinate.source, place.coordinate.minus) == ("motor", "load")
    # Without an effect nothing is left of the port in the equations.
    assert not any(
        ca.depends_on(model.exact.rates, symbol) for symbol in ca.symvar(model.exact.perturbation)
    )


@pytest.mark.parametrize("turned", [0, 3])
def test_a_coupling_acts_between_bodies_whatever_they_weigh(turned: int) -> None:
    # Parameters are tried at values that hang on their order, and what they weigh is none of it.
    model = drivetrain()
    order = (*model.parameters[turned:], *model.parameters[:turned])
    place = Survey(replace(model, parameters=order)).place("motor_speed_load_speed.exchange")
    assert (place.coordinate.source, place.coordinate.minus) == ("motor", "load")


@pytest.mark.parametrize("gear", [0.25, 4.0])
def test_a_geared_coupling_is_as_far_apart_as_it_is_bent(gear: float) -> None:
    # The slower body tells: the other's place is reduced to it.
    place = Survey(drivetrain(gear)).place("motor_speed_load_speed.exchange")
    ends = ("motor", "load") if gear > 1.0 else ("load", "motor")
    for local, suffix in ((place.coordinate, ""), (place.speed, "_speed")):
        assert (local.source, local.minus) == tuple(end + suffix for end in ends)
        assert local.ratio == pytest.approx(0.25)
    assert place.elastic


def test_what_is_offered_beside_an_exchange_can_be_attached() -> None:
    model = drivetrain()
    ranges = {argument_of(q.name): (-1.0, 2.0) for q in model.parameters}
    offered = [
        h for h in library(model, RecordedFacts(ranges=ranges)) if h.name.endswith("_argument")
    ]
    assert offered
    for law in offered:
        assert np.isfinite(model.with_effect(law.effect).rates([0.3, 0.1, 2.0, 1.5], [0.0])).all()


def test_no_exchange_turns_on_what_parameters_or_commands_are() -> None:
    model = drivetrain()
    equal = model.with_parameters({"rotor": 0.02, "inertia": 0.02, "damping": 0.0})
    for changed in (equal, equal.with_effect(gain("torque.command", excess=0.4))):
        assert ports(changed) == ports(model)


def test_what_a_drum_winds_up_is_as_far_apart_as_the_rope_is_long() -> None:
    """A body that turns and one that slides: the pull between them is a torque for the one."""

    def equations(m: Scope) -> Equations:
        radius, stretch = 0.1, 0.1 * m.x.angle - m.x.place
        return (
            {
                "angle": m.x.drum,
                "drum": (m.u.torque - radius * m.p.rope * stretch) / 0.02,
                "place": m.x.load,
                "load": (m.p.rope * stretch - m.p.weight) / 4.0,
            },
            {"drum": m.x.drum, "load": m.x.load},
        )

    model = machine(
        equations,
        "angle rad, drum rad/s, place m, load m/s",
        "torque N m",
        "drum rad/s, load m/s",
        "rope N/m 3e4 1e3 1e6, weight N 40 0 100",
    )
    assert ports(model) == ["drum_load.exchange"]
    place = Survey(model).place("drum_load.exchange")
    assert (place.coordinate.source, place.coordinate.minus) == ("angle", "place")
    assert place.coordinate.ratio == pytest.approx(0.1) and place.coordinate.unit == "m"
    assert (place.speed.source, place.speed.minus, place.speed.unit) == ("drum", "load", "m/s")
    stiffer = {h.name: h for h in library(model)}["cubic_stiffness_drum_load"]
    bent = model.with_effect(stiffer.at_size(1.0))
    x, u = [0.2, 0.0, 0.01, 0.0], [0.0]
    more = bent.rates(x, u) - model.rates(x, u)
    # Of 10 mm the cube, for the drum through its radius and inertia, for the load through its mass.
    assert more[[1, 3]] == pytest.approx([-1e-6, 1e-6 * 0.02 / 0.1 / 4.0], rel=1e-6)
