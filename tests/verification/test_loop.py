"""The sampled loop: order, conversion, held commands, changes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import casadi as ca
import control as ct
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from controllers import design_pid
from tests.machines import at_rest, machine
from tests.verification.scripted import Scripted
from workbench.errors import NumericalError, WorkbenchError
from workbench.linearisation import linear_model
from workbench.model import Effect, Model
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.simulation import simulate
from workbench.verification import Change, Disturbance, Scenario, Steps, verify

AXIS = ("position",), ("position",), ("force",)
REST = Scenario("rest", {"position": Steps((0.0,), (0.0,))}, 0.1, settle=0.0)


@pytest.fixture(scope="module")
def plant() -> Model:
    return arm(load_kg=3)


def at_30(**changes: Any) -> Scenario:
    rest = Scenario("rest", {"angle": Steps((0.0,), (math.radians(30),))}, 0.4, settle=0.0)
    return replace(rest, **changes)


def test_what_a_controller_does_not_command_stays_where_the_plant_rests() -> None:
    mixer = machine(
        lambda m: {
            "level": (m.u.cold + m.u.hot - 1.0) / 100.0,
            "warmth": (m.u.hot - m.x.warmth) / 50.0,
        },
        "level m 1, warmth 1 0.4",
        "cold 1 0 2, hot 1 0 2",
        "level m, warmth 1",
    )
    references = {"level": Steps((0.0,), (1.0,)), "warmth": Steps((0.0,), (0.4,))}
    run = verify(
        Scripted((0.6,), ("level",), ("level",), ("cold",), sample_time=1.0),
        mixer,
        Scenario("rest", references, 50.0, settle=0.0, sample_time=1.0).without_imperfections(),
    )
    assert np.ptp(run.outputs, axis=0) == pytest.approx(0.0, abs=1e-9)


def test_what_another_tool_wrote_is_the_full_plant() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rates = ca.vertcat(x[1], u - 4.0 * ca.sin(x[0]) - 0.4 * x[1])
    function = ca.Function("pendulum", [x, u], [rates, x[0]])
    system = ct.nlsys(
        lambda t, x, u, p: [x[1], u[0] - 4.0 * np.sin(x[0]) - 0.4 * x[1]],
        lambda t, x, u, p: x[0],
        inputs=1,
        outputs=1,
        states=2,
    )
    rest = Scenario("rest", {"y": Steps((0.0,), (0.0,))}, 2.0, settle=0.0, sample_time=0.01)
    pushed = Scripted((3.0,) * 200, ("y",), ("y",), ("u",), sample_time=0.01)
    exact = solve_ivp(
        lambda t, x: [x[1], 3.0 - 4.0 * np.sin(x[0]) - 0.4 * x[1]],
        (0.0, 1.99),
        (0.0, 0.0),
        rtol=1e-9,
    ).y[0, -1]
    for plant in (function, system):
        run = verify(pushed, plant, rest.without_imperfections())
        assert run.outputs[199, 0] == pytest.approx(exact, rel=1e-4)


def test_row_k_holds_what_was_read_and_then_commanded() -> None:
    controller = Scripted((0.0, 300.0, -300.0), *AXIS)
    run = verify(controller, servo_axis(), REST.without_imperfections())
    assert run.inputs[:4, 0].tolist() == [0.0, 300.0, -300.0, 0.0]
    for k, info in enumerate(run.infos):
        assert info["seen"] == (run["position"][k],)
    # The push commanded at sample 1 is first seen at sample 2.
    assert run["position"][1] == 0.0
    assert run["position"][2] > 0.0


def test_delays_of_a_linear_system_are_as_they_are() -> None:
    # Late by 3.5 and 2 samples, and both at once: a step is not seen before, nor the wrong way.
    text = "[exp(-0.35 s) / (s + 1), exp(-0.2 s); 0.5 / s, exp(-0.55 s) / (s + 1)]"
    linear = linear_model(text, limits=5.0)
    begin = Steps((0.0,), (0.0,))
    scenario = Scenario("rest", {"y_1": begin, "y_2": begin}, 2.0, sample_time=0.1, settle=0.0)
    t = 0.1 * np.arange(20)

    def lagging(delay: float) -> Any:
        return np.where(t > delay, 1.0 - np.exp(-(t - delay)), 0.0)

    names = ("y_1", "y_2"), ("y_1", "y_2")
    for k, wanted in enumerate(
        ((lagging(0.35), 0.5 * t), (np.where(t > 0.201, 1.0, 0.0), lagging(0.55)))
    ):
        law = replace(Scripted((1.0,), *names, (f"u_{k + 1}",)), sample_time=0.1)
        for plant in (linear.operating_point.model, linear):
            run = verify(law, plant, scenario)
            np.testing.assert_allclose(run.outputs, np.transpose(wanted), atol=1e-9)


def test_loop_is_the_simulation_of_its_own_commands(plant: Model) -> None:
    controller = Scripted((5.3, 4.9, 6.0, 4.2))
    run = verify(controller, plant, at_30(), tolerance=1e-8)
    again = simulate(plant, run.inputs, sample_time=0.002, start=run.states[0], check=False)
    for name in ("angle", "pressure_1", "temperature_2"):
        # Tolerances of 1e-8 and 1e-7 per step over 200 samples.
        scale = next(q.scale for q in plant.states if q.name == name)
        values = run.states[:, [q.name for q in plant.states].index(name)]
        others = again.states[:, [q.name for q in plant.states].index(name)]
        np.testing.assert_allclose(values, others, atol=1e-4 * scale)


def test_commands_are_clipped_and_quantised(plant: Model) -> None:
    controller = Scripted((5.0004, 12.0, -3.0, 7.1234))
    run = verify(controller, plant, at_30(duration=0.02))
    step = 10.0 / 4096
    assert run.inputs[:4, 0] == pytest.approx(
        [round(5.0004 / step) * step, 10.0, 0.0, round(7.1234 / step) * step], abs=1e-12
    )
    ideal = verify(controller, plant, at_30(duration=0.02).without_imperfections())
    assert ideal.inputs[3, 0] == 7.1234


def test_sensors_are_noisy_quantised_and_clipped(plant: Model) -> None:
    held = Scripted((5.0,), sensors=("angle", "pressure_1"))
    run = verify(held, plant, at_30(duration=8.0))
    counts = run.measurement("angle") / (2 * math.pi / 180_000)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    error = run.measurement("pressure_1") - run["pressure_1"]
    # 600 Pa of noise and a step of 244 Pa: 4000 samples know the rms within 3 %.
    assert float(np.std(error)) == pytest.approx(math.hypot(600.0, 244 / math.sqrt(12)), rel=0.04)
    bits = run.measurement("pressure_1") / (10e5 / 4096)
    np.testing.assert_allclose(bits, np.round(bits), atol=1e-6)
    exact = verify(held, plant, at_30().without_imperfections())
    assert np.array_equal(exact.measurement("angle"), exact["angle"])


def test_seed_decides_the_noise(plant: Model) -> None:
    linear = at_rest(plant, angle=math.radians(30))
    pid = design_pid(linear)
    one, again, other = (verify(pid, plant, at_30(), seed=s) for s in (1, 1, 2))
    assert np.array_equal(one.states, again.states)
    assert not np.array_equal(one.measured, other.measured)


def test_linear_plant_has_no_half_sample_shift() -> None:
    axis = servo_axis().without("coulomb_friction")
    linear = at_rest(axis, position=0.0)
    push = (100.0,) * 25 + (-200.0,) * 25
    run = verify(Scripted(push, *AXIS), linear, REST.without_imperfections())
    # m dv/dt + c v = F, closed form over each half: v tends to F/c with rate c/m.
    c, m = 200.0, 95.0
    t = run.time
    first = np.minimum(t, 0.05)
    v = 100 / c * (1 - np.exp(-c / m * first))
    x = 100 / c * (first - m / c * (1 - np.exp(-c / m * first)))
    later = np.maximum(t - 0.05, 0.0)
    fade = 1 - np.exp(-c / m * later)
    x = x + (v + 200 / c) * m / c * fade - 200 / c * later
    np.testing.assert_allclose(run["position"], x, atol=1e-12)


def test_parameter_changes_at_its_sample(plant: Model) -> None:
    held = Scripted((5.5,))
    still = verify(held, plant, at_30())
    changed = verify(held, plant, at_30(changes=(Change(0.2, "load", 5.0),)))
    load = [q.name for q in plant.parameters].index("load")
    assert changed.parameters[99, load] == 3.0
    assert changed.parameters[100, load] == 5.0
    # The state at 0.2 s still belongs to the old load; the one after it does not.
    np.testing.assert_array_equal(changed.states[:101], still.states[:101])
    assert changed["angle"][101:] != pytest.approx(still["angle"][101:], abs=1e-9)


def test_disturbance_accelerates_the_joint(plant: Model) -> None:
    free = plant.without("damper", "bearing_friction")
    scenario = at_30(disturbances=(Disturbance(0.1, "joint.torque", 2.0, until=0.104),))
    run = verify(Scripted((5.0,)), free, scenario)
    speed = run["speed"]
    assert abs(speed[50]) < 1e-9
    # 2 N m for 4 ms on 0.466 kg m2; the stiffness has taken away 0.1 % by then.
    assert speed[52] - speed[50] == pytest.approx(2.0 * 0.004 / 0.466, rel=5e-3)


def test_preview_gives_the_coming_references() -> None:
    steps = Steps((0.0, 0.01), (0.0, 1.0))
    scenario = replace(REST, references={"position": steps}, duration=0.02)
    controller = Scripted((0.0,), *AXIS, preview=2)
    run = verify(controller, servo_axis(), scenario)
    assert run.infos[2]["wanted"] == (0.0, 0.0, 0.0)
    assert run.infos[3]["wanted"] == (0.0, 0.0, 1.0)
    assert run.infos[-1]["wanted"] == (1.0, 1.0, 1.0)


def test_settling_before_the_record_is_not_recorded(plant: Model) -> None:
    controller = Scripted(tuple(range(5000)))
    run = verify(controller, plant, at_30(duration=0.01, settle=0.004))
    assert run.inputs[:3, 0].tolist() == pytest.approx([2.0, 3.0, 4.0], abs=2e-3)
    assert run.time[0] == 0.0


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (
            {"sample_time": 0.001},
            "give the scenario sample_time=0.001, or the design sample_time=0.0",
        ),
        ({"sensors": ("speed",)}, "sensor is 'speed'"),
        ({"controlled": ("postion",)}, "did you mean 'position'"),
        ({"actuators": ("valve",)}, "actuator is 'valve'"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, Any], problem: str) -> None:
    controller = replace(Scripted((0.0,), *AXIS), **change)
    with pytest.raises(WorkbenchError, match=problem):
        verify(controller, servo_axis(), REST)


def test_a_linear_model_cannot_change(plant: Model) -> None:
    linear = at_rest(plant, angle=math.radians(30))
    held = Scripted((5.0,))
    with pytest.raises(WorkbenchError, match="use the full plant"):
        verify(held, linear, at_30(changes=(Change(0.1, "load", 4.0),)))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"changes": (Change(0.1, "laod", 4.0),)}, "did you mean 'load'"),
        ({"changes": (Change(0.1, "load", 40.0),)}, "valid range is 0 to 8"),
        ({"disturbances": (Disturbance(0.1, "joint.torq", 4.0),)}, "joint.torque"),
    ],
)
def test_bad_changes_are_refused_before_the_run(
    plant: Model, changes: dict[str, Any], problem: str
) -> None:
    with pytest.raises(WorkbenchError, match=problem):
        verify(Scripted((5.0,)), plant, at_30(**changes))


def test_what_explicit_steps_cannot_follow_goes_to_rosenbrock() -> None:
    # Speed dies out within 0.1 us: 20,000 such times in a sample.
    grease = Effect("grease", ("axis.force",), lambda at: at.value - 1e9 * at.signals.speed)
    stiff = servo_axis().with_effect(grease)
    controller = Scripted((5.0,), *AXIS)
    with pytest.raises(NumericalError, match="rosenbrock"):
        verify(controller, stiff, REST, method="erk")
    run = verify(controller, stiff, REST)
    assert run.integrator.startswith("rosenbrock")
    assert abs(run["position"][-1]) < 1e-6


def test_what_an_output_shows_at_once_begins_as_the_plant_rests() -> None:
    """The flow of a turbine is what its gate lets through, from the first sample on."""
    turbine = machine(
        lambda m: (
            {"level": (10.0 - 2.6 * m.u.gate * np.sqrt(m.x.level)) / 80.0},
            {"flow": 2.6 * m.u.gate * np.sqrt(m.x.level)},
        ),
        "level m 50",
        "gate 1 0 1 0.3",
        "flow m3/s",
    )
    still = Scripted((10.0 / 2.6 / 50.0**0.5,), ("flow",), ("flow",), ("gate",), sample_time=1.0)
    scenario = Scenario("rest", {"flow": Steps((0.0,), (10.0,))}, 4.0, settle=0.0, sample_time=1.0)
    run = verify(still, turbine, scenario)
    assert run["flow"][0] == pytest.approx(10.0, rel=1e-6)
