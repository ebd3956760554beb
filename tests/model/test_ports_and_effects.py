"""The model language: ports, effects in their order, states of effects, what is refused."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.machines import machine
from workbench.errors import WorkbenchError
from workbench.model import (
    Effect,
    EffectView,
    Input,
    Model,
    Output,
    Parameter,
    PortView,
    Scope,
    State,
)
from workbench.model.expressions import cofactor
from workbench.operating_point import operating_point
from workbench.physics.friction import coulomb_friction
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.arm import arm
from workbench.plants.plant import adopt
from workbench.plants.servo_axis import servo_axis


def tank_equations(m: Scope):  # type: ignore[no-untyped-def]
    outflow = m.port(
        "tank.outflow", m.p.conductance * m.x.level, unit="m3/s", signals={"level": m.x.level}
    )
    m.publish("tank.head", 9.81 * m.x.level, unit="m2/s2")
    measurement = m.port("level.reading", m.x.level, unit="m")
    return {"level": (m.u.inflow - outflow) / m.p.area}, {"level": measurement}


def tank(**changes: object) -> Model:
    parts: dict[str, object] = {
        "name": "tank",
        "equations": tank_equations,
        "states": (State("level", "m", initial=1.0),),
        "inputs": (Input("inflow", "m3/s"),),
        "outputs": (Output("level", "m"),),
        "parameters": (
            Parameter("area", "m2", value=2.0, lower=0.1),
            Parameter("conductance", "m2/s", value=0.5, lower=0.0),
        ),
    }
    return Model(**(parts | changes))  # type: ignore[arg-type]


def adds(amount: float, name: str = "adds", port: str = "tank.outflow") -> Effect:
    return Effect(name, (port,), lambda at: at.value + amount)


DOUBLES = Effect("doubles", ("tank.outflow",), lambda at: 2 * at.value)


def lag(time: float = 0.1) -> Effect:
    """A sensor that follows the level, started at the level."""

    def rates(effect: EffectView) -> dict[str, object]:
        return {"sensed": (effect.at["level.reading"].value - effect.x.sensed) / effect.p.time}

    return Effect(
        "lag",
        ("level.reading",),
        lambda at: at.x.sensed,
        parameters=(Parameter("time", "s", value=time, lower=1e-3),),
        states=(State("sensed", "m"),),
        rates=rates,
        start=lambda effect: {"sensed": effect.at["level.reading"].value},
    )


def test_effects_act_in_the_order_in_which_they_were_attached() -> None:
    # 0.5 m3/s leaves the tank of 2 m2 by itself.
    first_adds = tank().with_effect(adds(0.1), DOUBLES)
    first_doubles = tank().with_effect(DOUBLES, adds(0.1))
    assert first_adds.rates([1.0], [0.0])[0] == pytest.approx(-(0.5 + 0.1) * 2 / 2)
    assert first_doubles.rates([1.0], [0.0])[0] == pytest.approx(-(0.5 * 2 + 0.1) / 2)


def test_an_effect_attached_twice_under_two_names_acts_twice() -> None:
    model = tank().with_effect(adds(0.1), replace(adds(0.1), name="again"))
    assert model.rates([1.0], [0.0])[0] == pytest.approx(-0.7 / 2)


def test_states_of_an_effect_join_the_model() -> None:
    model = tank().with_effect(lag())
    assert [q.name for q in model.states] == ["level", "lag.sensed"]
    assert [q.name for q in model.parameters] == ["area", "conductance", "lag.time"]
    assert model.rates([1.0, 0.8], [0.0]) == pytest.approx([-0.25, 2.0])
    assert model.read([1.0, 0.8], [0.0]) == pytest.approx([0.8])


def test_states_of_an_effect_start_where_it_says_unless_given() -> None:
    model = tank().with_effect(lag())
    assert model.initial_state({"level": 3.0}) == pytest.approx([3.0, 3.0])
    assert model.initial_state({"level": 3.0, "lag.sensed": 1.0}) == pytest.approx([3.0, 1.0])


def test_an_effect_sees_every_signal_of_the_model() -> None:
    seen: dict[str, bool] = {}

    def rates(effect: EffectView) -> dict[str, object]:
        seen["names"] = {"tank.head", "tank.outflow", "level.reading"} <= set(effect.values)
        return {"z": effect.values["tank.head"] - effect.values["tank.outflow"]}

    effect = Effect(
        "watch", ("level.reading",), lambda at: at.value, states=(State("z", "1"),), rates=rates
    )
    model = tank().with_effect(effect, DOUBLES)
    # It sees the final value of the port: after the effect that was attached behind it.
    assert model.rates([1.0, 0.0], [0.0])[1] == pytest.approx(9.81 - 1.0)
    assert seen["names"]


def test_an_effect_sees_at_its_port_the_signal_before_itself() -> None:
    views: list[PortView] = []

    def transform(at: PortView):  # type: ignore[no-untyped-def]
        views.append(at)
        return at.value

    tank().with_effect(Effect("watch", ("level.reading", "tank.outflow"), transform))
    assert {(v.port, v.index) for v in views} == {("level.reading", 0), ("tank.outflow", 1)}


@pytest.mark.parametrize("model", [arm(3.0), servo_axis()], ids=["arm", "servo axis"])
def test_attaching_and_taking_away_is_a_round_trip(model: Model, rng: np.random.Generator) -> None:
    port = model.ports[0]
    signal = Effect(
        "guest",
        (port.name,),
        lambda at: at.value * at.p.gain + at.x.z,
        parameters=(Parameter("gain", "1", value=1.1),),
        states=(State("z", "1"),),
        rates=lambda effect: {"z": -effect.x.z},
    )
    back = model.with_effect(signal).without("guest")
    assert (back.states, back.parameters, back.effects) == (
        model.states,
        model.parameters,
        model.effects,
    )
    x = model.initial_state() * (1 + 0.01 * rng.standard_normal(len(model.states)))
    u = model.nominal_input
    assert np.array_equal(back.rates(x, u), model.rates(x, u))
    changed = model.with_effect(signal).rates([*x, 0.5], u)[: len(x)]
    assert not np.array_equal(changed, model.rates(x, u))


def test_every_built_in_effect_of_the_arm_can_be_left_out() -> None:
    model = arm(3.0, plane="vertical", silencers=True, line_volumes=True)
    names = [effect.name for effect in model.effects]
    expected = "force_correction end_flattening heat_exchange centre_leakage gravity damper"
    assert set(f"{expected} bearing_friction line_1 line_2 silencer_1 silencer_2".split()) == set(
        names
    )
    # Off every balance, silencers and lines included.
    pressures = {f"{n}_{i}.pressure": 1.2e5 * i for n in ("silencer", "line") for i in (1, 2)}
    x = model.initial_state({"angle": 0.2, "speed": 0.7, "temperature_1": 300.0, **pressures})
    values = dict(zip([q.name for q in model.states], x, strict=True))
    whole = dict(zip(values, model.rates(x, [5.3]), strict=True))
    for name in names:
        less = model.without(name)
        own = [q.name for q in less.states]
        rates = dict(zip(own, less.rates([values[n] for n in own], [5.3]), strict=True))
        assert any(abs(rates[n] - whole[n]) > 1e-9 * (1 + abs(whole[n])) for n in own), name
    assert model.without(*names).effects == ()


def test_a_port_lists_its_signals_unit_and_group() -> None:
    ports = {port.name: port for port in arm().ports}
    joint = ports["joint.torque"]
    assert (joint.unit, joint.group) == ("N m", "joint")
    assert {"angle", "speed", "load"} <= set(joint.signals)
    assert {"muscle_1.force", "chamber_1.flow", "chamber_1.heat", "valve.command"} <= set(ports)
    assert {"valve.spool", "supply.pressure", "angle.reading", "pressure_1.reading"} <= set(ports)


def test_parameters_change_values_and_keep_the_equations() -> None:
    model = tank()
    other = model.with_parameters({"area": 4.0})
    assert other.rates([1.0], [0.0])[0] == pytest.approx(-0.125)
    assert model.rates([1.0], [0.0])[0] == pytest.approx(-0.25)
    assert other.exact is model.exact
    # Also what is written down later, whoever asks first.
    assert other.regularised is model.regularised


def test_an_effect_with_another_size_has_the_equations_that_stand_already() -> None:
    effect = lag()
    slow = effect.with_parameters({"time": 2.0})
    model, size = tank(), "lag.time"
    lagging = model.with_effect(effect)
    slower = model.with_parameters({"area": 4.0}).with_effect(slow)
    assert slower.exact is lagging.exact and slower.regularised is lagging.regularised
    assert (lagging.parameter(size).value, slower.parameter(size).value) == (0.1, 2.0)
    assert (lagging.parameter("area").value, slower.parameter("area").value) == (2.0, 4.0)
    # Another law of the name has its own.
    assert model.with_effect(lag()).exact is not lagging.exact


def refusals() -> list[tuple[str, object, str]]:
    two = State("level", "m")
    return [
        ("port", lambda: tank().with_effect(adds(1.0, port="tank.outflw")), "'tank.outflow'?"),
        ("twice", lambda: tank().with_effect(DOUBLES, DOUBLES), "attached already"),
        ("without", lambda: tank().with_effect(DOUBLES).without("dubles"), "did you mean"),
        ("parameter", lambda: tank().with_parameters({"are": 1.0}), "did you mean 'area'?"),
        ("bounds", lambda: tank().with_parameters({"area": 0.0}), "valid range is 0.1 to inf m2"),
        ("nan", lambda: tank().with_parameters({"area": float("nan")}), "area is nan"),
        ("state", lambda: tank().initial_state({"lvl": 1.0}), "state is 'lvl'"),
        ("infinite", lambda: tank().initial_state({"level": float("inf")}), "not finite"),
        ("shape", lambda: tank().rates([1.0, 2.0], [0.0]), "needs 1: level"),
        ("finite", lambda: tank().rates([float("nan")], [0.0]), "not finite"),
        ("input", lambda: tank().rates([1.0], []), "needs 1: inflow"),
        ("form", lambda: tank().form("regularized"), "did you mean 'regularised'?"),
        ("names", lambda: tank(states=(two, two)), "uses the name 'level' twice"),
        ("unit", lambda: State("level", "m/(s"), "write symbols, joined by spaces"),
        ("not SI", lambda: tank(states=(State("level", "mm"),)), "do not belong together"),
        ("no port", lambda: Effect("e", (), lambda at: at.value), "names no port"),
        (
            "no rates",
            lambda: Effect("e", ("p",), lambda at: at.value, states=(two,)),
            "needs both or neither",
        ),
    ]


@pytest.mark.parametrize(("call", "text"), [r[1:] for r in refusals()], ids=lambda v: str(v)[:30])
def test_mistakes_are_one_clear_sentence(call, text: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(WorkbenchError) as caught:
        call()
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("equations", "text"),
    [
        (lambda m: ({}, {"level": m.x.level}), "no rate of state 'level'"),
        (lambda m: ({"level": 0.0}, {}), "no measurement of output 'level'"),
        (lambda m: ({"level": 0.0, "lvl": 0.0}, {"level": 0.0}), "undeclared rate of state 'lvl'"),
        (lambda m: ({"level": m.x.lvl}, {"level": 0.0}), "did you mean 'level'?"),
        (lambda m: ({"level": m.p.aera}, {"level": 0.0}), "did you mean 'area'?"),
        (
            lambda m: ({"level": m.port("a.b", 1.0, unit="m") + m.port("a.b", 1.0, unit="m")}, {}),
            "opens? 'a.b' twice|'a.b' twice",
        ),
        (lambda m: ({"level": m.port("a.b", 1.0, unit="m/(s")}, {}), "cannot be read"),
    ],
)
def test_incomplete_equations_are_refused(equations, text: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(WorkbenchError, match=text):
        tank(equations=equations)


def test_an_effect_that_forgets_a_rate_is_refused() -> None:
    effect = Effect(
        "e", ("level.reading",), lambda at: at.value, states=(State("z", "1"),), rates=lambda e: {}
    )
    with pytest.raises(WorkbenchError, match=r"no rate of state 'e\.z'"):
        tank().with_effect(effect)


def test_a_signal_that_a_port_does_not_offer_is_named() -> None:
    effect = Effect("e", ("tank.outflow",), lambda at: at.value * at.signals.speed)
    with pytest.raises(WorkbenchError, match=r"signal at port tank\.outflow is 'speed'"):
        tank().with_effect(effect)


@pytest.mark.parametrize("tilted", [False, True])
def test_an_accelerometer_feels_what_acts_at_a_rate(tilted: bool) -> None:
    def equations(m: Scope):  # type: ignore[no-untyped-def]
        def fall():  # type: ignore[no-untyped-def]
            return (m.u.force - m.p.k * m.x.travel) / m.p.mass

        felt = 0.5 * fall() + 9.81 if tilted else fall()
        return {"travel": m.x.speed, "speed": fall()}, {
            "felt": felt, "load": m.p.k * m.x.travel, "speed": m.x.speed,
        }  # fmt: skip

    cabin = machine(
        equations,
        "travel m scale=0.1, speed m/s scale=1",
        "force N scale=100",
        "felt m/s2, load N, speed m/s",
        "k N/m 2e4, mass kg 250",
    )
    pushed = cabin.with_effect(adds(3.0, port="speed.rate"))
    x, u = np.array([0.02, 0.3]), np.array([500.0])
    more = np.subtract(pushed.rates(x, u), cabin.rates(x, u))
    assert more == pytest.approx([0.0, 3.0])
    seen = np.subtract(pushed.read(x, u), cabin.read(x, u))
    assert seen == pytest.approx([1.5 if tilted else 3.0, 0.0, 0.0])


def test_a_meter_of_the_flow_into_a_store_reads_what_acts_on_it() -> None:
    def equations(m: Scope):  # type: ignore[no-untyped-def]
        flow = (m.u.pressure - m.x.volume / m.p.compliance) / m.p.resistance
        return {"volume": flow}, {"flow": flow, "volume": m.x.volume}

    lung = machine(
        equations,
        "volume m3 scale=5e-4",
        "pressure Pa scale=2000",
        "flow m3/s scale=1e-3, volume m3 scale=5e-4",
        "resistance Pa s/m3 1e6, compliance m3/Pa 4e-7",
    )
    more = lung.with_effect(adds(1e-4, port="volume.rate"))
    x, u = np.array([2e-4]), np.array([1e3])
    assert np.subtract(more.rates(x, u), lung.rates(x, u)) == pytest.approx([1e-4])
    assert np.subtract(more.read(x, u), lung.read(x, u)) == pytest.approx([1e-4, 0.0])


def test_a_parameter_that_multiplies_two_things_has_no_argument() -> None:
    k, x, y = (ca.SX.sym(name) for name in "kxy")
    found = cofactor(k * x + 1.0, k)
    assert found is not None
    assert ca.is_equal(found, x)
    assert cofactor(k * x + k * y, k) is None
    assert cofactor(x / k - y, k) is not None
    assert cofactor(k / x, k) is None


def test_a_law_means_the_state_where_an_input_has_its_name() -> None:
    press = machine(
        lambda m: {"ram": m.x.speed, "speed": m.u.speed - 2.0 * m.x.speed},
        "ram m, speed m/s",
        "speed m/s2",
        "ram m",
    )
    rubbed = press.with_effect(coulomb_friction("speed.rate", level=3.0, transition_speed=1e-6))
    assert rubbed.rates([0.0, -1.0], [7.0])[1] == pytest.approx(7.0 + 2.0 + 3.0)


@pytest.mark.parametrize(
    ("equations", "told"),
    [
        (lambda m: [m.u.inflow], "return a list; return two mappings"),
        (lambda m: {"depth": m.u.inflow}, "no rate of state 'level'"),
        (
            lambda m: ({"level": max(m.u.inflow, m.x.level)}, {"level": m.x.level}),
            "'max' cannot decide: take np.where",
        ),
        (lambda m: ({"level": m.u.inflow / 0}, {"level": m.x.level}), "rate of level is no number"),
    ],
)
def test_what_a_newcomer_writes_first_is_refused_with_what_to_write(
    equations: Any, told: str
) -> None:
    def tank() -> Model:
        return machine(equations, "level m", "inflow m/s", "level m")

    with pytest.raises(WorkbenchError, match=told), warnings.catch_warnings():
        operating_point(adopt(tank, "my_plants:tank").model())


def test_rates_alone_show_the_states_that_outputs_are_called_after() -> None:
    def cup() -> Model:
        return Model(
            "cup",
            lambda m: {"warmth": (m.u.room - m.x.warmth) / m.p.time, "mass": -m.p.lost},
            states=(State("warmth", "degC", initial=80.0), State("mass", "g", initial=200.0)),
            inputs=(Input("room", "degC", nominal=20.0),),
            outputs=(Output("mass", "kg"), Output("warmth", "degF")),
            parameters=(Parameter("time", "min", value=10.0), Parameter("lost", "g/min", value=2)),
        )

    model = adopt(cup, "my_plants:cup").model()
    read = model.exact.outputs_function([353.15, 0.2], [293.15], model.values)
    assert np.ravel(read) == pytest.approx([0.2, 353.15])
    assert model.rates([353.15, 0.2], [293.15]) == pytest.approx([-0.1, -2e-3 / 60.0])


def test_functions_of_numbers_are_refused_where_symbols_stand() -> None:
    with pytest.raises(WorkbenchError, match="rate of level of 'tank' is not a number"):
        tank(
            equations=lambda m: ({"level": m.u.inflow - math.sin(m.x.level)}, {"level": m.x.level})
        )


def test_functions_of_numpy_stand_in_equations_without_a_word() -> None:
    def model() -> Model:
        return machine(
            lambda m: {"warmth": m.u.heat - np.maximum(np.exp(m.x.warmth), np.sqrt(m.x.warmth))},
            "warmth 1",
            "heat 1",
            "warmth 1",
        )

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert model().rates([0.25], [0.0])[0] == pytest.approx(-math.exp(0.25))


def test_a_model_with_other_values_is_opened_with_them() -> None:
    def equations(m: Scope):  # type: ignore[no-untyped-def]
        return {"level": (m.u.pump - m.x.level) / m.p.area}

    tank = machine(equations, "level m", "pump m", "level m", "area s 2")
    assert tank.opened().parameter("area").value == 2.0
    assert tank.with_parameters({"area": 3.0}).opened().parameter("area").value == 3.0


def test_what_changes_a_parameter_of_an_effect_goes_with_it() -> None:
    axis = servo_axis()
    known = {
        e.name: e.effect for e in library(axis, RecordedFacts(duration=10.0, sample_time=0.01))
    }
    worn = axis.with_effect(known["parameter_jump_coulomb_friction_level"])
    assert [e.name for e in worn.without("coulomb_friction").effects] == ["viscous_friction"]
    # Its time scales are those without friction, worn or not.
    assert worn.horizon == axis.horizon
