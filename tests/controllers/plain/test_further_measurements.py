"""Laws that read outputs which nobody follows: a pendulum that stands on a cart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import control as ct
import numpy as np
import pytest

from controllers.plain.loop import loop_of, spare_outputs
from controllers.plain.selection import settled_after
from controllers.plain.transfer_law import pid_by_hand
from tests.controllers.families import designed
from tests.controllers.in_c import agrees_on
from tests.machines import at_rest, machine, stepped
from workbench.errors import WorkbenchError
from workbench.linearisation import linear_model
from workbench.model import Model, Scope
from workbench.plants.arm import arm
from workbench.study.margins import analyse_loop
from workbench.study.step_trial import hardly_stable
from workbench.verification import step_scenario, verify

H = 0.01


def pendulum() -> Any:
    """A pendulum of 0.2 kg and 0.5 m on a cart of 1 kg, which a force moves; both are measured."""
    g, cart, bob, length = 9.81, 1.0, 0.2, 0.5
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 1:3] = -0.1, -bob * g / cart
    A[3, 1:3] = 0.1 / length, (cart + bob) * g / (cart * length)
    B = np.array([[0.0], [1.0 / cart], [0.0], [-1.0 / (cart * length)]])
    C = np.eye(4)[[0, 2]]
    return ct.ss(A, B, C, 0, inputs="force", outputs=["cart", "angle"], name="pendulum")


@pytest.mark.parametrize(
    ("name", "long"),
    [
        ("lqi", 3.0),
        ("plain-h-infinity", 8.0),
        ("plain-mpc", 3.0),
        ("plain-pid", 4.0),
        ("plain-sliding-mode", 3.0),
    ],
)
def test_a_pendulum_on_a_cart_is_held_by_both_its_sensors(
    name: str, long: float, tmp_path: Path
) -> None:
    linear = linear_model(pendulum(), limits={"force": (-20.0, 20.0)})
    law = designed(name, linear, sample_time=H)
    assert (law.sensors, law.controlled) == (("cart", "angle"), ("cart",))
    at_command = next(found for found in analyse_loop(law, linear) if found.command)
    assert at_command.stable and at_command.sensitivity < 2.0
    run = verify(
        law, linear, step_scenario("cart", 0.0, 0.2, lead=0.5, hold=long + 2.0, sample_time=H)
    )
    late = np.abs(run["cart"] - 0.2)[run.time > long]
    assert late.max() < 0.02 * 0.2
    assert settled_after(law, linear, {"cart": 0.2}) < long + 1.0
    agrees_on(run, law, tmp_path, 1e-11)


@pytest.mark.long
def test_what_the_followed_output_shows_well_enough_needs_no_other_sensor() -> None:
    A, B = np.array([[0.0, 1.0], [0.0, -2.0]]), np.array([[0.0], [1.0]])
    both, one = (
        ct.ss(A, B, np.eye(2)[:k], 0, inputs="force", outputs=["way", "speed"][:k]) for k in (2, 1)
    )
    assert designed("lqi", both, sample_time=H) == designed("lqi", one, sample_time=H)
    law = designed("lqi", both, also_measured="speed", sample_time=H)
    assert law.sensors == ("way", "speed") and law.controlled == ("way",)
    with pytest.raises(WorkbenchError, match=r"measured output is 'sped'.*did you mean 'speed'"):
        designed("lqi", both, also_measured="sped")


def test_a_pid_around_another_reads_what_it_needs() -> None:
    whole = pendulum()
    C = np.vstack([whole.C, [[0.0, 1.0, 0.0, 0.0]]])
    three = ct.ss(whole.A, whole.B, C, 0, inputs="force", outputs=["cart", "angle", "speed"])
    linear = linear_model(three, limits={"force": (-20.0, 20.0)})
    law = designed("plain-pid", linear, sample_time=H)
    assert law.sensors == ("cart", "angle") and law.name == "PID cascade"
    # An inner loop has no integral, which a pendulum that swings to rest would never empty.
    assert np.array(law.by_output)[1].tolist() == [0.0, 0.0]


def test_a_body_on_wheels_has_an_h_infinity_controller_that_is_stable_by_itself() -> None:
    # Of all that fear errors of the pitch as much as one of the way, none is.
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 1:3], A[3, 1:3] = (-0.238, -10.0), (0.34, 28.3)
    B = np.array([[0.0], [0.385], [0.0], [-0.646]])
    wheels = ct.ss(A, B, np.eye(4)[[0, 2]], 0, inputs="torque", outputs=["way", "pitch"])
    linear = linear_model(wheels, limits={"torque": (-60.0, 60.0)})
    told = {"speed": 5.0, "also_measured": "pitch", "sample_time": 0.005}
    assert designed("plain-h-infinity", linear, **told).sensors == ("way", "pitch")


def test_a_cart_with_a_heavy_brake_is_held_by_an_h_infinity_controller_of_few_volts() -> None:
    # Of those that may take a fifth of what the plant moves by itself, none is stable by itself.
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 1:3], A[3, 1:3] = (-8.2, -2.4), (24.8, 37.0)
    B = np.array([[0.0], [1.84], [0.0], [-5.58]])
    cart = ct.ss(A, B, np.eye(4)[[0, 2]], 0, inputs="voltage", outputs=["cart", "angle"])
    linear = linear_model(cart, limits={"voltage": (-10.0, 10.0)})
    law = designed("plain-h-infinity", linear, measured="cart", sample_time=0.005)
    worst = max(loop.sensitivity for loop in analyse_loop(law, linear) if loop.command)
    assert worst < 1.8 and settled_after(law, linear, {"cart": 0.1}) < 15.0


@pytest.mark.long
def test_a_plant_that_grows_sooner_than_its_commands_act_is_said() -> None:
    linear = linear_model("1 / (s - 5)", limits={"u": (-2.0, 2.0)})
    for name in ("lqi", "plain-mpc", "plain-pid", "plain-sliding-mode"):
        with pytest.raises(WorkbenchError, match=r"Mt below 2\.73, .* late by less than 66\.7 ms"):
            designed(name, linear, sample_time=0.002, delay=0.2)


def test_a_plant_that_grows_beside_a_zero_of_its_only_sensor_is_said() -> None:
    # A cart's place alone: zero of the pendulum at rest, pole of it on the cart.
    cart = linear_model(pendulum()).select(outputs=["cart"])
    said = (
        r"cart by force, which grows at 4\.8\d .* zero at 4\.43 .* Ms below 2\d[^;]*; measure more$"
    )
    for name in ("lqi", "plain-pid", "plain-h-infinity"):
        with pytest.raises(WorkbenchError, match=said):
            designed(name, cart, sample_time=H)


@pytest.mark.parametrize(
    ("gain", "said"),
    [(1.0, ""), (4.0, ""), (5.4, "hardly stable: Ms"), (8.5, "not st")],
)
def test_a_loop_with_next_to_no_margins_is_said(gain: float, said: str) -> None:
    # 1 / (s + 1)^3 bears a gain of 8.
    linear = linear_model(ct.tf([1.0], [1.0, 3.0, 3.0, 1.0], inputs="u", outputs="y"))
    law = pid_by_hand(gain, measured="y", actuator="u", sample_time=1e-3)
    found = hardly_stable(law, linear)
    assert found.startswith(said) and bool(found) == bool(said)


@pytest.mark.long
def test_what_makes_a_much_better_loop_is_read_too() -> None:
    # A buck converter with a load of constant power; the current tells where the voltage goes.
    inductance, capacity = 1e-4, 4.7e-4
    A = [[-0.05 / inductance, -1.0 / inductance], [1.0 / capacity, 0.09 / capacity]]
    names = {"inputs": ["duty"], "outputs": ["voltage", "current"]}
    buck = ct.ss(A, [[24.0 / inductance], [0.0]], [[0.0, 1.0], [1.0, 0.0]], 0, **names)
    linear = linear_model(buck, limits={"duty": (-0.5, 0.5), "voltage": (-3.0, 3.0)})
    both, alone = (
        designed("lqi", plant, measured="voltage", sample_time=1e-5, noise=0.01)
        for plant in (linear, linear.select(outputs=["voltage"]))
    )
    assert both.sensors == ("voltage", "current") and alone.sensors == ("voltage",)
    after = [settled_after(law, linear, {"voltage": 1.0}) for law in (both, alone)]
    assert after[0] < 0.5 * after[1]


@pytest.mark.long
def test_a_cascade_that_reads_one_of_several_outputs_is_judged_by_what_it_reads() -> None:
    linear = at_rest(arm(3.0), angle=np.radians(30.0))
    law = designed("plain-pid", linear)
    assert len(law.sensors) == 2 < len(linear.output_names)


def test_what_no_command_moves_is_not_read_too() -> None:
    A = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -2.0]])
    C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    plant = linear_model(
        ct.ss(A, [[0.0], [1.0], [0.0]], C, 0, outputs=["place", "speed", "weight"])
    )
    # Its scale over what commands make of it is no number, with which slycot took minutes.
    assert spare_outputs(plant, loop_of(plant, "place")) == ("speed",)


@pytest.mark.parametrize("name", ["lqi", "plain-sliding-mode"])
def test_what_is_read_otherwise_than_the_model_shows_it_leads_no_speed_astray(name: str) -> None:
    def winder(friction: float) -> Model:
        def equations(m: Scope) -> dict[str, Any]:
            torque = 0.12 * m.x.current - 4e-4 * m.x.speed - friction * ca.tanh(m.x.speed)
            voltage = m.u.voltage - 0.95 * m.x.current - 0.12 * m.x.speed
            return {"current": voltage / 3e-3, "speed": torque / 2.4e-3}

        return machine(
            equations,
            "current A, speed rad/s",
            "voltage V -48 48",
            "speed rad/s 0.3, current A 0.02",
        )

    # By the current alone, a shaft that rubs is faster than it is.
    linear = at_rest(winder(0.0))
    told = {"sample_time": 0.001, "also_measured": "current", "measured": "speed"}
    law = designed(name, linear, **told)
    found = stepped(law, winder(0.33), "speed", 0.0, 40.0, hold=0.6)
    assert found["settling_time"] < (0.1 if name == "lqi" else 0.25)


@pytest.mark.long
def test_noise_keeps_no_loop_from_holding_what_grows() -> None:
    # A bicycle, balanced by its steering.
    bicycle = machine(
        lambda m: {
            "lean": m.x.roll,
            "roll": 9.8 * m.x.lean - 14.5 * m.x.steer - 1.8 * m.u.rate,
            "steer": m.u.rate,
        },
        "lean rad, roll rad/s, steer rad",
        "rate rad/s -3 3",
        "lean rad 2e-3, steer rad 1e-3",
    )
    linear = at_rest(bicycle)
    law = designed("plain-pid", linear, measured="lean")
    # By hand a PID settles in 1 s.
    assert settled_after(law, linear, {"lean": 0.1}) < 1.5


@pytest.mark.long
@pytest.mark.parametrize("name", ["lqi", "plain-mpc", "plain-h-infinity"])
def test_several_commands_have_the_margins_at_them_where_more_is_read(name: str) -> None:
    # A rocket that lands: its place to the side is led by its attitude, which is read too.
    A, B, C = np.zeros((6, 6)), np.zeros((6, 2)), np.eye(6)[[0, 2, 4]]
    A[0, 1] = A[2, 3] = A[4, 5] = 1.0
    A[1, 4], A[5, 4] = 9.81, 0.02
    B[1, 0], B[3, 1], B[5, 0] = 9.81, 5e-5, -0.785
    names = {"inputs": ["gimbal", "thrust"], "outputs": ["place", "height", "attitude"]}
    ends = {"gimbal": (-0.14, 0.14), "thrust": (-1e5, 2e5), "place": (-10.0, 10.0)}
    ends |= {"height": (-10.0, 10.0), "attitude": (-0.1, 0.1)}
    linear = linear_model(ct.ss(A, B, C, 0, **names), limits=ends)
    law = designed(name, linear, measured=("place", "height"), sample_time=0.05)
    assert law.sensors == ("place", "height", "attitude")
    whole = analyse_loop(law, linear)[-1]
    assert whole.opened == "all at once" and whole.sensitivity < 2.0
    assert not hardly_stable(law, linear)
