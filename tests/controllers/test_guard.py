"""The guard: nothing on clean data, a documented reaction to every fault, and a way back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from controllers import design_pid
from controllers.guard import (
    CommandLimits,
    Guard,
    Guarded,
    ReferenceLimits,
    SensorLimits,
    unguarded,
)
from controllers.joint.schedule import JointSchedule
from controllers.linear_law import linear_law
from tests.controllers.families import designed
from tests.controllers.families import family as family_of
from tests.machines import at_rest, machine
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.verification import Run, SignalFault, guarded, metrics, step_scenario, verify

DEG = math.pi / 180.0
STEP = step_scenario("angle", 30, 40, unit="deg", hold=0.4)
BEGIN = 0.504
"""After the step, with the joint at rest still."""

FAMILIES = {
    "PD on the angle": family_of("angle-pd"),
    "fixed PID": family_of("pid"),
    "scheduled PID": family_of("scheduled-pid"),
    "super-twisting": family_of("scheduled-sliding-mode"),
    "state feedback": family_of("scheduled-state-feedback"),
    "linear MPC": family_of("mpc"),
}

SPOILED = {
    "a missing angle": SignalFault(BEGIN, "angle", "missing", until=BEGIN + 0.002),
    "a missing reference": SignalFault(BEGIN, "reference.angle", "missing", until=BEGIN + 0.002),
    "a spike of the angle": SignalFault(BEGIN, "angle", "offset", 0.3, until=BEGIN + 0.002),
}
"""Faults of one sample: what each may cost is the difference of one estimate."""


@pytest.fixture(scope="module", params=list(FAMILIES))
def family(
    request: pytest.FixtureRequest, schedule: JointSchedule, linear: LinearModel, plant: Model
) -> tuple[Any, Run]:
    """A controller of each family in its guard, and its run without a fault."""
    law = guarded(FAMILIES[request.param](schedule, linear), plant, at={"angle": 30 * DEG})
    return law, verify(law, plant, STEP)


def actions(run: Run) -> list[str]:
    return [str(info["guard_action"]) for info in run.infos if "guard" in info]


def test_guard_changes_no_bit_of_a_clean_run(family: tuple[Guarded, Run], plant: Model) -> None:
    law, clean = family
    bare = verify(law.controller, plant, STEP)
    np.testing.assert_array_equal(bare.inputs, clean.inputs)
    assert actions(clean) == []
    found = metrics(clean)
    assert [found[f"guard_{what}"].value for what in ("clamped", "held", "safe")] == [0, 0, 0]
    assert not any(name.startswith("guard") for name in metrics(bare))


@pytest.mark.parametrize("fault", SPOILED.values(), ids=SPOILED.keys())
def test_one_bad_sample_costs_nothing(
    fault: SignalFault, family: tuple[Guarded, Run], plant: Model
) -> None:
    law, clean = family
    run = verify(law, plant, replace(STEP, faults=(fault,)))
    assert actions(run) == ["clamp" if "reference" in fault.signal else "estimate"]
    assert np.isfinite(run.inputs).all()
    # It does the same, one sample later at most; a hundredth of a degree for the noise.
    late = np.abs(np.diff(clean["angle"])).max() + 0.01 * DEG
    assert np.abs(run["angle"] - clean["angle"]).max() < 1.1 * late


def test_missing_in_a_move_is_bridged_by_what_the_pressures_say(
    family: tuple[Guarded, Run], plant: Model
) -> None:
    law, clean = family
    if law.sensors == ("angle",):
        pytest.skip("it reads no pressures")
    fault = SignalFault(0.55, "angle", "missing", until=0.65)
    run = verify(law, plant, replace(STEP, faults=(fault,)))
    assert actions(run)[:50] == ["estimate"] * 50
    assert np.abs(run["angle"] - clean["angle"]).max() < 3.0 * DEG
    assert abs(run["angle"][-1] - 40 * DEG) < 0.5 * DEG


def test_missing_for_longer_falls_back_and_returns_without_a_bump(
    family: tuple[Guarded, Run], plant: Model
) -> None:
    law, _ = family
    law = Guarded(law.controller, replace(law.guard, bridge=10, inner=20))
    fault = SignalFault(0.3, "angle", "missing", until=0.4)
    run = verify(law, plant, replace(STEP, faults=(fault,)))
    # 50 samples missing, and 10 more that are plausible again before the law returns.
    assert actions(run)[:60] == ["estimate"] * 10 + ["inner"] * 20 + ["safe"] * 30
    np.testing.assert_array_equal(run["valve"][180:210], 5.0)
    # No more than what the noise of the sensors makes of a valve at rest.
    assert np.abs(np.diff(run["valve"][209:240])).max() < 1.0
    assert abs(run["angle"][249] - 30 * DEG) < 0.5 * DEG


def test_controller_without_limits_survives_a_missing_sample(linear: LinearModel) -> None:
    scenario = replace(STEP, faults=(SPOILED["a missing angle"],))
    run = verify(design_pid(linear), linear, scenario)
    assert actions(run) == ["hold"]
    assert metrics(run)["guard_held"].value == 1.0
    assert np.isfinite(run.inputs).all()


@dataclass(frozen=True)
class Told:
    """A law that commands what it is told by its reference, and remembers how often it stepped."""

    name: str = "told"
    sample_time: float = 0.01
    sensors: tuple[str, ...] = ("y",)
    controlled: tuple[str, ...] = ("y",)
    actuators: tuple[str, ...] = ("u",)
    preview: int = 0

    def initial_state(self, measurement: tuple[float, ...]) -> int:
        return 0

    def step(self, state: int, measurement: Any, reference: Any) -> Any:
        if measurement[0] == 7.0:
            raise ZeroDivisionError
        command = math.nan if measurement[0] == 6.0 else reference[0]
        return (command,), state + 1, {}

    def linear_command(self, command: tuple[float, ...]) -> tuple[float, ...]:
        return command


def told(**changes: Any) -> Guarded:
    limits = {
        "sensors": (SensorLimits(-10.0, 10.0, jump=2.0),),
        "references": (ReferenceLimits(-5.0, 5.0, tolerance=0.5, sensor=0.0),),
        "commands": (CommandLimits(0.0, -4.0, 4.0),),
        "hold": 2,
        "settle": 3,
        "ramp": 4,
        **changes,
    }
    return Guarded(Told(), Guard(**limits))  # type: ignore[arg-type]


def played(law: Guarded, rows: list[tuple[float, float]]) -> list[tuple[float, str]]:
    """Return command and action of every sample, for measurements and references."""
    state = law.initial_state((rows[0][0],))
    found = []
    for y, r in rows:
        (command,), state, info = law.step(state, (y,), (r,))
        found.append((command, str(info.get("guard", "clear"))))
    return found


def test_reference_is_clamped_to_what_the_plant_declares() -> None:
    assert played(told(), [(0, 1.0), (0, 9.0), (0, -9.0), (0, math.nan), (0, 1.0)]) == [
        (1.0, "clear"),
        (5.0, "reference"),
        (-5.0, "reference"),
        (-5.0, "reference"),
        (1.0, "clear"),
    ]


def test_another_level_is_believed_after_the_safe_command() -> None:
    found = played(told(hold=1), [(0.0, 1.0)] * 2 + [(9.0, 1.0)] * 12)
    assert [name for _, name in found] == [
        *["clear"] * 2, *["jump"] * 3, *["returning"] * 7, *["clear"] * 2,
    ]  # fmt: skip
    # Held, safe, settled; then the reference moves from what is measured to what is asked.
    assert [command for command, _ in found[2:]] == [
        *[1, 0, 0, 0, 0, 0],
        *[8.171875, 5, 1.828125, 1, 1, 1],
    ]


def test_law_that_fails_is_started_anew() -> None:
    for bad in (6.0, 7.0):
        law = told(sensors=(SensorLimits(),))
        found = played(law, [(0.0, 1.0)] * 2 + [(bad, 1.0)] * 4 + [(0.0, 1.0)] * 9)
        assert [name for _, name in found[2:]] == [
            *["law"] * 3, *["returning"] * 7, *["clear"] * 3,
        ]  # fmt: skip
        assert [command for command, _ in found[2:9]] == [1, 1, 0, 0, 0, 0, 0.103515625]


def test_start_without_a_measurement_is_safe() -> None:
    found = played(told(), [(math.nan, 1.0)] * 2 + [(3.0, 1.0)] * 8)
    assert [command for command, _ in found] == [
        *[0] * 6,
        *[2.79296875, 2, 1.20703125, 1],
    ]


def test_encoder_that_stays_is_stuck_once_the_pressures_say_that_the_arm_moves(
    family: tuple[Guarded, Run], plant: Model
) -> None:
    law, clean = family
    if law.sensors == ("angle",):
        pytest.skip("it reads no pressures")
    fault = SignalFault(0.45, "angle", "stuck")
    run = verify(law, plant, replace(STEP, faults=(fault,)))
    first = next(i for i, info in enumerate(run.infos) if info.get("guard") == "stuck")
    # After some degrees of motion, at the step from 0.5 s on; the move ends near where it should.
    assert 0.5 < run.time[first] < 0.6
    assert abs(run["angle"][first] - 30 * DEG) < 3.0 * DEG
    assert np.abs(run["angle"] - clean["angle"]).max() < 10.0 * DEG


def test_what_oscillates_is_brought_to_rest(linear: LinearModel, plant: Model) -> None:
    scenario = replace(STEP, duration=3.0, late_samples=10)
    law = guarded(design_pid(linear), plant, at={"angle": 30 * DEG})
    run, bare = verify(law, plant, scenario), verify(law.controller, plant, scenario)
    assert np.ptp(bare["angle"][-250:]) > 3.0 * DEG
    first = next(i for i, info in enumerate(run.infos) if info.get("guard") == "oscillation")
    # Given up for as long as nothing gets better may last: at rest first, then with a shut valve.
    acting = int(law.guard.inner)
    assert 250 <= acting < 400
    assert actions(run)[: acting + 1] == ["inner"] * acting + ["safe"]
    assert len(actions(run)) == len(run.infos) - first


def test_what_runs_into_a_stop_is_brought_to_rest(linear: LinearModel, plant: Model) -> None:
    # From the step on the law opens the valve fully, away from the reference.
    law = guarded(design_pid(linear), plant, at={"angle": 30 * DEG})

    class Misled:
        def __getattr__(self, name: str) -> Any:
            return getattr(law.controller, name)

        def step(self, state: Any, measurement: Any, reference: Any) -> Any:
            command, state, info = law.controller.step(state, measurement, reference)
            return (command if reference[0] < 35 * DEG else (0.0,)), state, info

    def hit(guard: Guard | None) -> tuple[float, list[str]]:
        run = verify(Guarded(Misled(), guard), plant, replace(STEP, duration=1.0))
        touching = np.flatnonzero(run["lower_stop.torque"] > 0.0)
        speed = float(abs(run["speed"][touching[0]])) / DEG if len(touching) else 0.0
        return speed, [str(info["guard"]) for info in run.infos if "guard" in info]

    bare, _ = hit(None)
    speed, found = hit(law.guard)
    assert bare > 200.0 and speed < 100.0
    assert found[0] == "runaway"


def test_law_that_is_late_is_held_and_then_replaced(linear: LinearModel, plant: Model) -> None:
    law = guarded(design_pid(linear), plant, at={"angle": 30 * DEG})
    for until, found in ((0.556, ["hold"] * 3), (0.65, ["hold"] * 5 + ["inner"] * 45)):
        fault = SignalFault(0.55, "deadline", "missing", until=until)
        run = verify(law, plant, replace(STEP, faults=(fault,), duration=1.2))
        assert actions(run)[: len(found)] == found
        assert abs(run["angle"][-1] - 40 * DEG) < 0.5 * DEG
    late = Guarded(law.controller, replace(law.guard, deadline=-1.0))
    state = late.initial_state((0.5, 3e5, 3e5))
    _, _, info = late.step(state, (0.5, 3e5, 3e5), (0.5,))
    assert (info["guard"], info["guard_action"]) == ("deadline", "hold")


def test_what_gets_no_better_is_given_up_for_a_time() -> None:
    for reference, name in ((4.5, "saturated"), (2.0, "no_progress")):
        rows = [(0.01 * (k % 2), reference) for k in range(40)]
        found = [what for _, what in played(told(patience=10), rows)]
        first = found.index(name)
        assert first in (9, 10, 11)
        # As long as it was tried it is left alone; then it is tried again.
        assert found[first + 1 : first + 15] == ["returning"] * 14
        assert found[first + 15] == "clear"


def test_limits_are_what_the_plant_declares(plant: Model, linear: LinearModel) -> None:
    law = design_pid(linear)
    for found in (guarded(law, plant, at={"angle": 30 * DEG}).guard, guarded(law, linear).guard):
        angle, pressure, _ = found.sensors
        assert (pressure.lower, pressure.upper) == (0.0, 10e5)
        # Under full command from rest the arm runs at up to 9 rad/s; a sample has 2 ms.
        assert 0.02 < angle.jump < 0.1
        low, high = found.references[0][:2]
        assert (low, high) == (0.0, pytest.approx(60 * DEG))
        assert found.commands[0] == (5.0, 0.0, 10.0)
        assert found.estimator is not None
        # The pressures alone hold the estimate of the angle where it rests.
        own = found.estimator
        z = own.start @ np.array([0.0, 1e4, -1e4])
        assert own.expected(z) - own.rest == pytest.approx([0.0, 1e4, -1e4], abs=1.0)


def test_guard_is_no_part_of_the_linear_law(linear: LinearModel) -> None:
    law = design_pid(linear)
    rest, reference = tuple(linear.y0[:3].tolist()), (float(linear.y0[0]),)
    for own, inside in zip(
        linear_law(law, rest, reference),
        linear_law(guarded(law, linear), rest, reference),
        strict=True,
    ):
        np.testing.assert_array_equal(own, inside)
    assert unguarded(guarded(law, linear)) is law


def test_refusals(linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match="has a guard already"):
        Guarded(told())
    with pytest.raises(WorkbenchError, match="limits for 1 sensors"):
        Guarded(design_pid(linear), told().guard)
    with pytest.raises(WorkbenchError, match="hold of a guard"):
        told(hold=-1)


def guarded_pump(noise: float) -> Guarded:
    """A PID of a tank that one pump fills through a pipe, and another that nobody steps."""
    plant = machine(
        lambda m: (
            {"flow": (m.u.pump - m.x.flow) / 5.0, "h": 0.01 * (m.x.flow + m.u.other - m.x.h)},
            {"h": m.x.h},
        ),
        "flow m/s scale=1, h m scale=1",
        "other m/s -5 5 scale=1, pump m/s -5 5 scale=1",
        f"h m {noise} scale=1",
    )
    rest = {"h": 0.0, "other": 0.0}
    law = designed("plain-pid", at_rest(plant, **rest), actuator="pump", sample_time=0.5)
    return guarded(law, plant, at=rest)


def test_a_stuck_sensor_is_found_where_another_input_is_not_commanded() -> None:
    guard = guarded_pump(1e-3)
    assert guard.guard.estimator is not None
    random, x, highest, found = np.random.default_rng(3), np.zeros(2), 0.0, set()
    state, stuck = guard.initial_state((0.0,)), 0.0
    for k in range(800):
        # Stuck at rest, 10 s before a step, for 200 s.
        seen = stuck if 20 <= k < 420 else x[1] + random.normal(0.0, 1e-3)
        stuck = seen if k < 20 else stuck
        (u,), state, info = guard.step(state, (float(seen),), (0.0 if k < 40 else 1.0,))
        found.add(info.get("guard", ""))
        # The exact answer of both lags over half a second, in ten steps.
        for _ in range(10):
            x = x + 0.05 * np.array([(u - x[0]) / 5.0, 0.01 * (x[0] - x[1])])
        highest = max(highest, x[1])
    assert "stuck" in found
    assert highest < 1.3 and abs(x[1] - 1.0) < 0.1


def test_noise_is_no_oscillation() -> None:
    guard = guarded_pump(0.03)
    state, random = guard.initial_state((0.0,)), np.random.default_rng(5)
    for _ in range(2000):
        _, state, info = guard.step(state, (float(random.normal(0.0, 0.03)),), (0.0,))
        assert "guard" not in info
