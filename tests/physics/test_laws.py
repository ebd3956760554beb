"""Laws meet plants that nobody here prepared: a law from outside, a circuit, a heated tank."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import casadi as ca
import cloudpickle
import control as ct
import numpy as np
import pytest

from tests.machines import conveyor, machine
from tests.model.test_sizes import crane
from tests.physics.effects.bench import offered
from workbench.errors import WorkbenchError
from workbench.model import Effect, Model
from workbench.model.linear_system import model_of_system
from workbench.model.units import per
from workbench.physics.friction import coulomb_friction, viscous_friction
from workbench.physics.library import LAWS, library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.stores import outflow_exponent
from workbench.physics.survey import Survey
from workbench.plants.servo_axis import servo_axis

OWN_LAW = '''
"""A magnet that pulls towards the middle."""

from workbench.physics.law import Law, each, size

magnet = Law(
    "magnet",
    "F = -pull x / (1 + x^2)",
    each("force", needs=("coordinate",)),
    lambda at: (size("pull", at.unit, 0.1 * at.scale, at.scale, "pull"),),
    lambda at: at.value - at.p.pull * at.signals.coordinate / (1.0 + at.signals.coordinate**2),
    look_alikes=("linear_spring",),
)
'''


def circuit() -> Model:
    """A coil, a resistor and a capacitor, with no local signals declared."""

    def equations(m):
        rest = m.u.source - m.p.resistance * m.x.i - m.x.q / m.p.capacity
        voltage = m.port("coil.voltage", rest, unit="V", scale=10.0)
        return {"q": m.x.i, "i": voltage / m.p.inductance}, {"current": m.x.i}

    return machine(
        equations,
        "q A s scale=1e-3, i A scale=0.1",
        "source V scale=10",
        "current A scale=0.1",
        "resistance V/A 10, capacity A s/V 1e-4, inductance V s/A 0.1",
    )


def heated_tank() -> Model:
    """A tank that a heater warms."""

    def equations(m):
        heat = m.port("tank.heat", m.u.heater, unit="W", scale=1000.0)
        return {"warmth": heat / m.p.capacity}, {"reading": m.x.warmth}

    return machine(
        equations,
        "warmth K 293 scale=300",
        "heater W scale=1000",
        "reading K scale=300",
        "capacity J/K 1e4",
    )


def test_a_law_from_outside_is_tried(tmp_path: Path) -> None:
    (tmp_path / "my_physics.py").write_text(OWN_LAW)
    law = LAWS.get("my_physics:magnet", folder=tmp_path)
    found = {h.name: h for h in library(servo_axis(), extra=[law])}
    assert found["magnet"].ports == ("axis.force",)
    assert found["magnet"].unit == "N"
    model = servo_axis().with_effect(found["magnet"].at_size(5.0))
    change = model.rates([0.5, 0.0], [0.0]) - servo_axis().rates([0.5, 0.0], [0.0])
    assert change[1] == pytest.approx(-5.0 * 0.5 / 1.25 / 95.0)


@pytest.mark.long
def test_every_law_goes_to_other_processes() -> None:
    for model in (circuit(), heated_tank(), servo_axis()):
        offered_here = library(model)
        for law in offered_here:
            # What a process does with it, it does with what was written down of it.
            other = pickle.loads(cloudpickle.dumps(law))  # noqa: S301
            trace = model.with_effect(other.at_size(0.1 * other.typical_size)).exact
            own = model.with_effect(law.at_size(0.1 * law.typical_size)).exact
            assert trace.rates.shape == own.rates.shape, law.name
    assert "sensor_lead" in {h.law for h in library(heated_tank())}


def test_a_head_or_a_pressure_is_the_force_on_what_flows() -> None:
    for unit, of in (("m", "m3/s"), ("Pa", "kg/s")):
        duct = machine(
            lambda m, unit=unit: (
                {"flow": m.p.share * m.port("head", m.u.above - m.p.loss * m.x.flow, unit=unit)},
                {"read": m.x.flow},
            ),
            f"flow {of}",
            f"above {unit} 0 10",
            f"read {of}",
            f"share {per(per(of, 's'), unit)} 0.1, loss {per(unit, of)} 0.2 0 2",
        )
        place = Survey(duct).place("head")
        assert (place.role, place.speed.source) == ("force", "flow")
        assert {"quadratic_drag", "coulomb_friction"} <= {h.law for h in library(duct)}


def test_speed_and_coordinate_follow_from_structure() -> None:
    place = Survey(circuit()).place("coil.voltage")
    assert (place.role, place.speed.source, place.coordinate.source) == ("circuit", "i", "q")
    names = {h.law for h in library(circuit())}
    assert {"coulomb_friction", "cubic_stiffness", "bouc_wen_hysteresis", "offset"} <= names
    damped = circuit().with_effect(viscous_friction("coil.voltage", coefficient=2.0))
    assert damped.parameters[-1].unit == "V/A"
    more = circuit().rates([0.0, 0.1], [0.0])[1] - 2.0 * 0.1 / 0.1
    np.testing.assert_allclose(damped.rates([0.0, 0.1], [0.0])[1], more)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_depth_of_a_cage_tells_the_angle_of_its_drum(way: float) -> None:
    def equations(m):
        torque = m.u.motor - m.p.damping * m.x.spin
        return {"depth": way * 2.0 * m.x.spin, "spin": torque / 3.0}

    hoist = machine(
        equations,
        "depth m 10 scale=80, spin rad/s scale=5",
        "motor N m scale=10",
        "depth m scale=80",
        "damping N m s/rad 1",
    ).opened()
    place = Survey(hoist).place("spin.rate")
    at = place.coordinate
    assert (at.source, at.unit, at.scale, at.start) == ("depth", "rad", 40.0, way * 5.0)
    rope = offered(hoist, "linear_spring").at_size(0.2, {"rest": 0.0})
    model = hoist.with_effect(rope)
    # An angle of 20 rad, turned back by 0.2 of it.
    change = model.rates([40.0, 0.0], [0.0]) - hoist.rates([40.0, 0.0], [0.0])
    assert change[1] == pytest.approx(-way * 0.2 * 20.0)


def test_a_store_may_lose_what_it_holds() -> None:
    laws = {h.law: h for h in library(heated_tank())}
    assert laws.keys() >= {"heat_loss", "radiation", "second_store", "gain", "drive_lag"}
    empties = {"orifice_outflow", "linear_outflow", "quadratic_outflow", "saturating_outflow"}
    assert laws.keys().isdisjoint({*empties, "overflow"})
    tank = heated_tank()
    # Nor does a temperature run out whose rate the equations give without a port.
    bare = replace(
        tank, equations=lambda m: ({"warmth": m.u.heater / 1e4}, {"reading": m.x.warmth})
    )
    assert empties.isdisjoint(h.law for h in library(bare.opened()))
    loss = laws["heat_loss"]
    assert loss.unit == "W/K"
    model = heated_tank().with_effect(loss.at_size(3.0, {"ambient": 280.0}))
    assert model.rates([300.0], [0.0])[0] == pytest.approx(-3.0 * 20.0 / 1e4)


def test_place_and_speed_of_one_body_over_another() -> None:
    def equations(m):
        twist = m.x.angle_1 - m.x.angle_2
        shaft = m.port("shaft.torque", m.p.stiffness * twist, unit="N m")
        return {
            "angle_1": m.x.speed_1,
            "angle_2": m.x.speed_2,
            "speed_1": m.u.torque - shaft,
            "speed_2": shaft,
        }, {"angle": m.x.angle_2}

    states = "angle_1 rad, angle_2 rad, speed_1 rad/s, speed_2 rad/s"
    model = machine(equations, states, "torque rad/s2", "angle rad", "stiffness 1/s2 4")
    place = Survey(model).place("shaft.torque")
    speed, at = place.speed, place.coordinate
    assert (speed.source, speed.minus, at.source, at.minus) == (
        "speed_2", "speed_1", "angle_1", "angle_2",
    )  # fmt: skip
    assert (at.sign, place.elastic) == (-1.0, True)
    harder = model.with_effect(offered(model, "cubic_stiffness").at_size(2.0))
    assert harder.signals([0.3, -0.2, 0, 0], [0.0])["shaft.torque"] == pytest.approx(2.25)


def test_a_follower_begins_within_a_usual_slack() -> None:
    model = machine(lambda m: {"level": m.u.valve}, "level m", "valve 1", "level m")
    slack = offered(model, "backlash")
    # From farther off a filter takes it beyond the slack, where it learns no more of it.
    assert [q.start_rms for q in slack.effect.states] == [slack.typical_size]


def test_place_and_speed_over_what_carries_a_body() -> None:
    def seat(m):
        travel, speed = m.x.height - m.u.floor, m.x.speed - m.u.floor_speed
        pushed = -((1.0 + travel) ** 3.0 - 1.0) * m.p.stiffness - 3.0 * speed - m.p.drag * m.x.speed
        return {"height": m.x.speed, "speed": pushed}, {"travel": travel}

    model = machine(
        seat,
        "height m, speed m/s",
        "floor m, floor_speed m/s",
        "travel m",
        "stiffness m/s2 40, drag 1/s 0.5",
    )
    place = Survey(model).place("speed.rate")
    assert (place.coordinate.source, place.coordinate.minus) == ("height", "")
    # Of a body that the air drags too its own speed counts.
    over = [(name, q.source, q.minus) for name, q in place.carried.items()]
    assert over == [("coordinate", "height", "floor")]
    stops = {h.name: h.at_size(500.0) for h in library(model) if h.law == "end_stops"}
    assert stops.keys() == {"end_stops", "end_stops_over_floor"}
    within = {"upper": 0.02, "lower": -0.02}
    seat_stops = model.with_effect(stops["end_stops_over_floor"].with_parameters(within))
    above = [0.31, 0.0], [0.3, 0.0]
    assert seat_stops.rates(*above)[1] == pytest.approx(model.rates(*above)[1], abs=1e-3)
    assert seat_stops.rates([0.0, 0.0], [0.03, 0.0])[1] > 4.0


def test_what_passes_less_what_an_input_takes_of_it_fills_a_store_through_its_throat() -> None:
    def shaft(taken):
        def equations(m):
            raised = m.p.head - m.x.level - m.p.loss * m.x.flow * ca.fabs(m.x.flow)
            return {"flow": 0.03 * raised, "level": (m.x.flow - taken(m)) / 60.0}

        return machine(
            equations,
            "flow m3/s, level m",
            "turbine m3/s 0 40",
            "level m, flow m3/s",
            "head m 100, loss s2/m5 0.01 1e-3 0.1",
        )

    found = shaft(lambda m: m.u.turbine)
    law = {h.name: h for h in library(found)}["quadratic_drag_over_turbine"].at_size(1e-4)
    state, taken = [20.0, 95.0], [26.0]
    # What flows on to the turbine, through the tunnel alone, loses nothing in the throat.
    changed = [
        found.with_effect(law).rates(x, u)[0] - found.rates(x, u)[0]
        for x, u in ((state, taken), ([26.0, 95.0], taken), ([32.0, 95.0], taken))
    ]
    assert changed == pytest.approx([0.0036, 0.0, -0.0036], abs=1e-12)
    # Where a level lets some out too, the two alone are not what passes the throat.
    leaking = shaft(lambda m: m.u.turbine + 0.1 * m.x.level)
    assert not [h.name for h in library(leaking) if h.name.endswith("_over_turbine")]


def test_a_transfer_function_of_second_order_rubs() -> None:
    model = model_of_system(ct.tf([2e4], [1.0, 150.0, 2.6e5]))
    law = {h.name: h for h in library(model)}["coulomb_friction"].at_size(600.0)
    # A speed of the output, and a place of 0: what rubs takes away from its rate, in 1/s.
    rates = model.with_effect(law).rates([100.0, 0.0], [0.0])
    assert rates == pytest.approx([-15600.0, 100.0])


def test_a_measured_force_resists_the_motion() -> None:
    def equations(m):
        force = m.port(
            "rig.force",
            m.p.damping * m.u.velocity,
            unit="N",
            signals={"v": m.u.velocity, "z": m.x.stretch},
        )
        return {"stretch": m.u.velocity}, {"force": force}

    rig = machine(equations, "stretch m", "velocity m/s", "force N", "damping N s/m 10")
    found = {h.name: h for h in library(rig)}
    assert {"bouc_wen_hysteresis", "polynomial_stiffness", "quadratic_drag"} <= found.keys()
    assert found["sensor_gain_force"].ports == ("force.reading",)
    dry = rig.with_effect(found["coulomb_friction"].at_size(0.4))
    assert dry.read([0.0], [2.0])[0] == pytest.approx(20.4)


def test_an_effect_takes_its_unit_from_the_port_and_keeps_changed_values() -> None:
    effect = coulomb_friction("axis.force", level=3.0).with_parameters({"level": 7.0})
    attached = servo_axis().without("coulomb_friction").with_effect(effect)
    assert attached.parameter("coulomb_friction.level").unit == "N"
    assert attached.parameter("coulomb_friction.level").value == 7.0
    assert attached.dry_effects == ("coulomb_friction",)
    with pytest.raises(WorkbenchError, match=r"axis\.forces.*axis\.force"):
        servo_axis().with_effect(coulomb_friction("axis.forces", name="more"))


def test_a_law_that_changes_no_parameter_stays_where_one_is_taken_away() -> None:
    # Dry effects are taken away to design; what acts at the same port does not need them.
    found = {h.name: h for h in library(servo_axis()) if h.ports == ("axis.force",)}
    stays = servo_axis().with_effect(found["quadratic_drag"].effect).without("viscous_friction")
    assert stays.effects[-1].name == "quadratic_drag"
    fade = found["parameter_fade_viscous_friction_coefficient"].effect
    left = servo_axis().with_effect(fade).without("viscous_friction")
    assert not {fade.name, "viscous_friction"} & {e.name for e in left.effects}


def test_a_plant_without_ports_is_offered_laws_where_it_can_have_them() -> None:
    def equations(m):
        pull = m.u.motor - 9.81 * m.x.swing
        return {"swing": m.x.turning, "turning": pull}, {"reading": m.x.swing}

    plain = machine(equations, "swing rad, turning rad/s", "motor rad/s2", "reading rad")
    assert [q.name for q in plain.ports] == ["motor.command", "turning.rate", "reading.reading"]
    found = {h.name: h for h in library(plain)}
    assert found["coulomb_friction"].ports == ("turning.rate",)
    assert found["sensor_lag_reading"].ports == ("reading.reading",)
    assert found["delay_motor_command"].ports == ("motor.command",)
    slowed = plain.with_effect(viscous_friction("turning.rate", coefficient=0.5))
    np.testing.assert_allclose(slowed.rates([0.1, 2.0], [3.0]), [2.0, 3.0 - 0.981 - 1.0])


def test_every_law_is_an_effect_at_a_port_of_which_the_name_alone_is_known() -> None:
    for name, law in LAWS.members().items():
        assert law("tank.outflow").ports == ("tank.outflow",), name


def test_a_flow_out_of_a_store_has_another_exponent_where_an_author_says_so() -> None:
    def equations(m):
        flow = m.port("tank.outflow", m.p.drain * m.x.level, unit="m3/s")
        return {"level": (m.u.inflow - flow) / m.p.area}, {"level": m.x.level}

    tank = machine(
        equations,
        "level m scale=1 initial=1",
        "inflow m3/s scale=1e-3",
        "level m scale=1",
        "drain m2/s 2e-3, area m2 0.5",
    )
    usual = outflow_exponent("tank.outflow").parameters[0].value
    emptied = tank.with_effect(outflow_exponent("tank.outflow", exponent=-0.5))
    assert usual == pytest.approx(0.1)
    # Half an exponent less at a level that is not the typical one, but for what rounds zero.
    ratio = emptied.rates([0.25], [0.0])[0] / tank.rates([0.25], [0.0])[0]
    assert ratio == pytest.approx(
        (0.25 / emptied.parameter("outflow_exponent.level_scale").value) ** -0.5, rel=5e-3
    )


def test_units_divide() -> None:
    assert per("V", "A") == "V/A"
    assert per("N", "m/s", 2) == "N s2/m2"
    # As units are read: superscripts, and a line that ends with the next symbol.
    assert per("m s⁻¹", "m²") == "1/(m s)" and per("W/m2 K", "K") == "W/m2"


def aircraft(shared: float) -> Model:
    """The short period: a pitch rate turns the wing into the wind, and lift takes it out again."""

    def equations(m):
        wing, pitch = m.x.wing, m.x.pitch
        return {
            "wing": shared * pitch - m.p.lift * wing,
            "pitch": m.p.moment * wing - m.p.damping * pitch - 12.0 * m.u.elevator,
        }, {"wing": wing, "pitch": pitch}

    return machine(
        equations,
        "wing rad, pitch rad/s",
        "elevator rad -0.4 0.4",
        "wing rad, pitch rad/s",
        "lift 1/s 1 0 3, moment 1/s2 3 0 9, damping 1/s 1.2 0 5",
    )


def test_a_pull_that_a_rope_passes_on_is_no_push_between_two_bodies() -> None:
    # The trolley of a crane, and the hoist, both have a speed in m/s.
    place = Survey(crane()).place("drive.command")
    assert (place.speed.source, place.speed.minus) == ("speed", "")


def test_a_place_that_a_speed_adds_to_may_be_carried_off_as_well() -> None:
    found = {h.name: h for h in library(aircraft(1.0))}
    assert found["cubic_stiffness"].ports == ("pitch.rate",)
    assert Survey(aircraft(1.0)).place("pitch.rate").coordinate.source == "wing"
    assert "cubic_stiffness" not in {h.name for h in library(aircraft(0.5))}


@pytest.mark.parametrize("lag", [0.0, 0.08])
def test_a_rotor_lifts_more_above_the_ground_and_a_weight_does_not(lag: float) -> None:
    def equations(m):
        thrust = m.x.thrust if lag else m.u.throttle
        lift = 22.0 * thrust / 1.6 - 0.1 * m.x.climb
        turning = {"thrust": (m.u.throttle - m.x.thrust) / lag} if lag else {}
        return {"height": m.x.climb, "climb": lift - 9.81} | turning

    states = "height m, climb m/s" + ", thrust 1" * (lag > 0.0)
    drone = machine(equations, states, "throttle 1 0 1", "height m")
    law = offered(drone, "ground_effect", ranges={"height": (0.3, 1.5)})
    # Below and above what was seen: a floor or a ceiling.
    assert {np.sign(shape["surface"] - shape["nearest"]) for shape in law.shapes} == {-1.0, 1.0}
    near = drone.with_effect(law.at_size(0.2, {"surface": 0.0, "nearest": 0.3}))
    rotor = [0.7] * (lag > 0.0)
    for height, grown in ((0.3, 0.2), (0.6, 0.05), (3.0, 0.002)):
        at = [height, 0.0, *rotor]
        more = near.rates(at, [0.7])[1] - drone.rates(at, [0.7])[1]
        assert more == pytest.approx(grown * 22.0 * 0.7 / 1.6)
    falling = [0.3, 1.0, *(0.0 * r for r in rotor)]
    assert near.rates(falling, [0.0])[1] == pytest.approx(drone.rates(falling, [0.0])[1])


def test_a_magnet_pulls_with_the_square_of_one_over_its_distance() -> None:
    door = servo_axis()
    law = offered(door, "surface_force", ranges={"position": (0.02, 0.9)})
    near = door.with_effect(law.at_size(-40.0, {"surface": -0.03, "nearest": 0.02}))
    for place, force in ((0.02, -40.0), (0.07, -10.0), (0.47, -0.4)):
        more = near.rates([place, 0.0], [0.0])[1] - door.rates([place, 0.0], [0.0])[1]
        assert 95.0 * more == pytest.approx(force)


def test_a_sensor_may_read_what_another_one_reads() -> None:
    def equations(m):
        rest = m.u.supply - 1.2 * m.x.current - 0.08 * m.x.speed
        torque = 0.08 * m.x.current - 3e-6 * m.x.speed**2
        return (
            {"current": rest / 0.02, "speed": torque / 0.004, "turned": m.x.speed},
            {"current": m.x.current, "pressure": 2.0 * m.x.speed**2, "turned": m.x.turned},
        )

    pump = machine(
        equations,
        "current A, speed rad/s, turned rad",
        "supply V 0 30",
        "current A, pressure Pa, turned rad",
    )
    heard = {h.name: h for h in library(pump) if h.law == "sensor_cross_talk"}
    # An angle beside what depends on its speed alone is late, or early.
    assert {name.removeprefix("sensor_cross_talk_") for name in heard} == {
        "current_supply", "pressure_supply", "turned_supply",
        "current_turned", "pressure_current", "turned_current",
    }  # fmt: skip
    law = heard["sensor_cross_talk_pressure_current"]
    shifted = pump.with_effect(law.at_size(600.0, {"zero": 0.0}))
    read = [model.read([5.0, 100.0, 0.0], [12.0])[1] for model in (pump, shifted)]
    assert read == pytest.approx([2e4, 2.3e4])


def test_what_acts_beside_a_gain_is_divided_by_the_same_inertia() -> None:
    # A weight on a rod that is drawn in: what turns it acts on m r^2, once, whatever acts before.
    rod = machine(
        lambda m: (
            {"turn": m.x.spin, "spin": (m.u.torque - m.p.rub * m.x.spin) / (2.0 * m.x.reach**2),
             "reach": m.u.draw},
            {"turn": m.x.turn},
        ),
        "turn rad 0, spin rad/s 3, reach m 1",
        "torque N m 5 lower=-10 upper=10, draw m/s lower=-1 upper=1",
        "turn rad",
        "rub N m s/rad 0.1 0 1",
    )  # fmt: skip
    drag, scaled = (
        next(h for h in library(rod) if h.law == law and h.ports == ("spin.rate",))
        for law in ("quadratic_drag", "gain_jump")
    )
    alone, beside = (
        rod.with_effect(drag.at_size(2e-5)),
        rod.with_effect(
            *[replace(scaled.at_size(0.0), name=f"gain_{k}") for k in range(8)], drag.at_size(2e-5)
        ),
    )
    for reach in (1.0, 0.5):
        plain, dragged, scaled_too = (
            m.rates(m.initial_state({"spin": 3.0, "reach": reach}), [1.0, 0.0])[1]
            for m in (rod, alone, beside)
        )
        assert plain - dragged == pytest.approx(2e-5 * 9.0 / reach**2)
        assert scaled_too == pytest.approx(dragged, rel=1e-12)
    sizes = [m.exact.rates_function.n_instructions() for m in (alone, beside)]
    assert sizes[1] < sizes[0] + 8 * 25


def test_two_laws_over_what_a_parameter_multiplies_stand_beside_each_other() -> None:
    plain = conveyor()
    seen = library(plain, RecordedFacts(ranges={"argument of grip": (-0.05, 0.05)}))
    law = next(h for h in seen if h.name == "parameter_curve_grip_over_argument")

    def rates(*effects: Effect) -> list[float]:
        bent = plain.with_effect(*effects)
        return np.ravel(bent.exact.rates_function([1.0, 0.46], [0.0], bent.values)).tolist()

    one, other = law.at_size(2.0, {"bend": 0.0}), replace(law.at_size(0.0), name="other")
    assert rates(one, other) == pytest.approx(rates(one), rel=1e-12)
    more = replace(law.at_size(1.0, {"bend": 0.0}), name="other")
    assert rates(one, more)[1] > 1.01 * rates(one)[1] > 1.02 * rates()[1]


def test_a_shaft_whose_turns_nobody_counts_turns_as_far_as_it_goes_meanwhile() -> None:
    def spindle(unit: str, fastest: float) -> Model:
        return machine(
            lambda m: {"speed": (m.p.gain * m.u.volts - m.x.speed) / 0.2},
            f"speed {unit} scale={fastest}",
            "volts V -10 10 scale=10",
            f"speed {unit}",
            f"gain {per(unit, 'V')} {fastest / 10.0}",
        )

    slow, fast = (
        next(h for h in library(m) if h.law == "bouc_wen_hysteresis")
        for m in (spindle("rad/s", 1.0), spindle("rad/s", 5000.0))
    )
    assert fast.effect.parameters[1].value == 5000.0 * slow.effect.parameters[1].value
    # A loop that turned within a thousandth of a sample could not be followed.
    assert slow.effect.parameters[1].value > 1e-3 * 0.2
