"""Exported C gives the numbers of the law over thousands of steps, carrying its own state.

The C code is started once and never set right again: what one step rounds differently, the next
ones inherit. Floats and C do the same operations in the same order, so most of them round alike;
what is left comes from the few that CasADi writes in another order (a square as a product, an
interpolation as a sum over switches) and from libraries' roots. Every law forgets: its observer,
filters and planner with the time constants of the loop, its integrals by anti-windup and by the
next crossing. So a rounding of 1e-16 of a signal stays far below 1e-12 of its scale, and a law in
which it grew would be seen here.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import control as ct
import numpy as np
import pytest

from controllers import AnglePD, MPCSpecification, design_mpc, design_pid
from controllers.c_export import export_c
from controllers.guard import Fault, Guarded
from controllers.joint.schedule import JointSchedule
from controllers.mpc.prediction import Prediction
from controllers.named_state import flat
from controllers.pid import design_scheduled_pid
from controllers.plain.pid_design import design_plain_pid
from controllers.quadratic_program.solver import STATUSES, ConicProgram
from tests.controllers.families import CLOSED_FORM, MPCS, family
from tests.controllers.in_c import STRICT, InC, built
from tests.machines import machine
from workbench.computing.machine_code import compiler
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel, linearise
from workbench.operating_point import operating_point
from workbench.verification import guarded

STEPS = 10_000
CHAINED = 5_500
"""Steps of a hard run that have passed every branch."""


def hard_run(law: Any) -> tuple[np.ndarray, np.ndarray]:
    """Measurements and references that pass every branch of planner, tables and limits.

    The angle follows steps and a sine with delay and noise, past both ends of the schedule; the
    reference jumps by up to 0.7 rad and so drives the valve to both stops; for some seconds the
    pressures lie out of their limits.
    """
    rng = np.random.default_rng(2)
    time = law.sample_time * np.arange(STEPS + law.preview)
    reference = 0.5 + 0.3 * np.sin(1.3 * time) + 0.35 * np.sign(np.sin(0.9 * time))
    angle = np.convolve(reference, np.ones(80) / 80, mode="same") + 1e-4 * rng.normal(
        size=len(time)
    )
    swing = 1.2e5 * np.sin(2.1 * time) + 8e2 * rng.normal(size=len(time))
    mean = 3.6e5 + 2.2e5 * (np.sin(0.5 * time) > 0.9) - 3.2e5 * (np.sin(0.5 * time) < -0.95)
    measured = np.column_stack([angle, mean + swing, mean - swing])
    return measured[:, : len(law.sensors)], reference


def compare(
    law: Any, in_c: InC, measurements: Any, reference: Any, *, openings: float = 1e-13
) -> dict[str, Any]:
    """Run both from one start; return the largest differences and what the run passed."""
    law = law if isinstance(law, Guarded) else Guarded(law)
    state = law.initial_state(tuple(measurements[0].tolist()))
    in_c.start(measurements[0].tolist())
    wanted = np.lib.stride_tricks.sliding_window_view(reference, 1 + law.preview)
    difference, drift, seen = 0.0, 0.0, {"commands": [], "slack": [], "statuses": set()}
    size = np.maximum(np.abs(np.array(flat(state))), 1e-9)
    for k, (row, ahead) in enumerate(zip(measurements.tolist(), wanted.tolist(), strict=False)):
        (command,), state, info = law.step(state, tuple(row), tuple(ahead))
        status = in_c.step(row, ahead)
        difference = max(difference, abs(in_c.command[0] - command))
        if k % 10 == 9:
            now = np.array(flat(state))
            size = np.maximum(size, np.abs(now))
            drift = max(drift, float(np.max(np.abs(np.array(in_c.state) - now) / size)))
        seen["commands"].append(command)
        seen["statuses"].add(status)
        assert Fault(status // 16).word == info.get("guard", "clear")
        if in_c.is_mpc and "status" in info:
            assert STATUSES[status % 16] == info["status"]
            assert in_c.report[3] == info["fallback"] == float(status % 16 != 0)
            assert abs(in_c.report[0] - info["opening"]) <= openings
            # The slack in Pa, of 10 bar and more; with a fallback there is none.
            slack = info["slack"]
            assert abs(in_c.report[1] - slack) <= 1e7 * openings or math.isnan(
                in_c.report[1] + slack
            )
            assert math.isnan(in_c.report[1]) == (status % 16 != 0)
            seen["slack"].append(slack)
    return {"difference": difference, "drift": drift, **seen}


@pytest.mark.parametrize("make", CLOSED_FORM.values(), ids=CLOSED_FORM.keys())
def test_c_agrees_over_thousands_of_chained_steps(
    make: Any, schedule: JointSchedule, linear: LinearModel, tmp_path: Path
) -> None:
    law = make(schedule, linear)
    measurements, reference = hard_run(law)
    found = compare(law, InC(law, tmp_path), measurements[:CHAINED], reference)
    # The command relative to the valve's range, 10 V; every entry of the state relative to the
    # largest value that it has had.
    assert found["difference"] / 10.0 <= 1e-12
    assert found["drift"] <= 1e-12
    # Both stops were met, less what a learned centre takes from the stroke.
    assert min(found["commands"]) < 0.01 and max(found["commands"]) > 9.99
    assert found["statuses"] == {0}


@pytest.mark.parametrize("make", MPCS.values(), ids=MPCS.keys())
def test_mpc_in_c_agrees_over_thousands_of_chained_steps(
    make: Any, schedule: JointSchedule, linear: LinearModel, tmp_path: Path
) -> None:
    law = make(schedule, linear)
    in_c = InC(law, tmp_path, *STRICT)
    measurements, reference = hard_run(law)
    found = compare(law, in_c, measurements[:CHAINED], reference)
    assert found["difference"] / 10.0 <= 1e-12
    assert found["drift"] <= 1e-12
    assert found["statuses"] == {0}
    # Hard limits were met, and soft ones were missed where the pressures lay outside.
    limit = law.valve.command(0.4 if make is MPCS["linear MPC with tight limits"] else 1.0)
    assert max(found["commands"]) == pytest.approx(limit, abs=1e-9)
    slack = np.array(found["slack"])
    assert slack.max() > 1e4
    assert (slack < 1.0).any()


def test_guard_of_c_is_that_of_the_law(linear: LinearModel, tmp_path: Path) -> None:
    # Everything that can be found, again and again: the whole guard against its twin in C.
    law = with_guard(
        guarded(AnglePD(20.0, 0.02), linear), patience=80, hold=3, bridge=8, inner=20, swings=6
    )
    rng = np.random.default_rng(3)
    measurements = 0.5 + 1e-3 * rng.normal(size=(3000, 1))
    reference = np.full(3000, 0.5)
    measurements[50:300], reference[50:300] = measurements[50], 0.8  # stuck
    reference[400:700] = 0.9  # saturated
    measurements[820:850, 0] += 0.014 * np.arange(30)  # runaway
    reference[900:1300] = 0.53  # no progress
    measurements[1300:1500, 0] += 0.02 * np.sin(0.5 * np.arange(200))  # oscillation
    for k in rng.integers(1500, 2900, 30):
        measurements[k : k + rng.integers(1, 12)] += rng.choice([np.nan, np.inf, 0.2, -0.8])
    reference[1500:][rng.random(1500) < 0.02] = np.nan
    reference[2000:2400] = 1.5
    found = compare(law, InC(law, tmp_path), measurements, reference)
    assert {Fault(status // 16).word for status in found["statuses"]} == {
        fault.word for fault in Fault if fault.word not in ("law", "deadline")
    }
    assert found["difference"] / 10.0 <= 1e-12
    assert found["drift"] <= 1e-12


def with_guard(law: Guarded, **settings: Any) -> Guarded:
    return Guarded(law.controller, replace(law.guard, **settings))


def test_missed_deadlines_of_c_are_those_of_the_law(linear: LinearModel, tmp_path: Path) -> None:
    law = with_guard(guarded(design_pid(linear), linear), hold=2, inner=10)
    in_c = InC(law, tmp_path, *STRICT)
    row = tuple(linear.y0[:3].tolist())
    state = law.initial_state(row)
    in_c.start(row)
    for k in range(60):
        asked = row[0] + 0.05
        if k in (5, 6, 20, *range(30, 50)):
            (command,), state, info = law.missed(state)
            status = in_c.missed()
        else:
            (command,), state, info = law.step(state, row, (asked,))
            status = in_c.step(row, [asked])
        assert Fault(status // 16).word == info.get("guard", "clear")
        assert in_c.command[0] == pytest.approx(command, abs=1e-9)
    assert law.missed(state)[2]["guard"] == "deadline"


def without_slack(prediction: Prediction) -> Prediction:
    """Make the pressure limits hard, so that they contradict the valve's limits at times."""
    matrix = prediction.A.copy()
    matrix[:, -1] = 0.0
    return replace(prediction, A=matrix)


@pytest.mark.parametrize("name", ["linear MPC", "scheduled MPC"])
def test_fallbacks_of_c_are_those_of_the_law(
    name: str, schedule: JointSchedule, linear: LinearModel, tmp_path: Path
) -> None:
    # Contradictory constraints at times, measurements and references that are no numbers at others.
    if name == "linear MPC":
        mpc = family("mpc", pressure_limits=(2.2e5, 5e5))(schedule, linear)
        mpc = replace(mpc, prediction=without_slack(mpc.prediction))
    else:
        mpc = family("scheduled-mpc", pressure_limits=(2.5e5, 4e5))(schedule, linear)
        mpc = replace(mpc, predictions=tuple(map(without_slack, mpc.predictions)))
    measurements, reference = hard_run(mpc)
    measurements[1000:1010, 1] = np.nan
    measurements[2000, 0] = np.inf
    reference[3000:3003] = np.nan
    found = compare(mpc, InC(mpc, tmp_path, *STRICT), measurements[:CHAINED], reference)
    # Contradictions by the law; a measurement and a reference that are no numbers by the guard.
    assert found["statuses"] & {0, 2, 48, 32, 16} == {0, 2, 48, 32, 16}
    assert {status // 16 for status in found["statuses"]} == {0, 1, 2, 3}
    assert found["difference"] / 10.0 <= 1e-12
    assert found["drift"] <= 1e-12
    assert np.isfinite(found["commands"]).all()


@pytest.mark.parametrize("make", [MPCS["scheduled MPC"], MPCS["linear MPC with tight limits"]])
def test_mpc_in_c_agrees_with_another_solver(
    make: Any, schedule: JointSchedule, linear: LinearModel, tmp_path: Path, monkeypatch: Any
) -> None:
    # Where a compiler is present both sides above run one solver. Another one sums its products in
    # another order, so the minimiser agrees to rounding times the condition of the Hessian (2e4)
    # and to the size of what cancels in this hard run (1e2): to 1e-10 of the opening, 1e-9 of 10 V
    # where the inverse valve curve is steepest (50 V per opening). That is why sums have one order
    # in what runs.
    def by_daqp(n: int, m: int, _: str = "") -> ConicProgram:
        return ConicProgram(n, m, "daqp")

    for module in ("controllers.mpc.whole_model", "controllers.mpc.along_plan"):
        monkeypatch.setattr(f"{module}.quadratic_program", lru_cache(by_daqp))
    law = make(schedule, linear)
    measurements, reference = hard_run(law)
    in_c = InC(law, tmp_path, *STRICT)
    found = compare(law, in_c, measurements[:600], reference, openings=1e-10)
    assert 0.0 < found["difference"] / 10.0 <= 1e-9


DRIVER = """
#include <stdio.h>
#include "law.h"
int main(void) {
  double measurement[LAW_MEASUREMENTS], reference[LAW_REFERENCES], state[LAW_STATES];
  double command[LAW_COMMANDS], report[LAW_REPORTS], sum = 0.0;
  int k, i, status = 0;
  for (k = 0; k < 3000; ++k) {
    measurement[0] = 0.5 + 0.02 * (k % 37);
    measurement[1] = 3.6e5 + 9e3 * (k % 41) - 4e5 * (k % 53 == 0);
    measurement[2] = 3.6e5 - 8e3 * (k % 43);
    if (k == 1500) measurement[1] = 0.0 / (k - 1500);
    for (i = 0; i < LAW_REFERENCES; ++i) reference[i] = 0.3 + 0.5 * ((k + i) / 500 % 2);
    if (k == 0) law_start(measurement, state);
    status |= law_step(measurement, reference, state, command, report);
    sum += command[0];
  }
  printf("%.3f %d\\n", sum / 3000, status);
  return 0;
}
"""


@pytest.mark.parametrize("name", ["scheduled MPC", "linear MPC with preview"])
def test_mpc_in_c_runs_clean_under_sanitizers(
    name: str, schedule: JointSchedule, linear: LinearModel, tmp_path: Path
) -> None:
    found = compiler()
    if found is None:
        pytest.skip("no C compiler on this machine")
    flags = ["-std=c99", "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    trial = tmp_path / "trial.c"
    trial.write_text("int main(void) { return 0; }\n")
    linked = [found, *flags, str(trial), "-o", str(tmp_path / "trial"), "-lm"]
    if subprocess.run(linked, capture_output=True, check=False).returncode:
        pytest.skip("the C compiler has no sanitizers on this machine")
    exported = export_c(MPCS[name](schedule, linear), tmp_path, name="law")
    driver = tmp_path / "driver.c"
    driver.write_text(DRIVER)
    program = tmp_path / "driver"
    sources = [str(driver), str(exported.source)]
    # The driver divides by zero on purpose, to make a measurement that is no number.
    quiet = "-fno-sanitize=float-divide-by-zero"
    subprocess.run([found, *flags, quiet, *sources, "-o", str(program), "-lm"], check=True)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    mean, status = done.stdout.split()
    assert 0.0 <= float(mean) <= 10.0
    # One measurement was not finite, and nothing else happened.
    assert status == "48"


def test_header_documents_the_interface(schedule: JointSchedule, tmp_path: Path) -> None:
    law = design_scheduled_pid(schedule)
    units = {"angle": "rad", "pressure_1": "Pa", "valve": "V"}
    exported = export_c(law, tmp_path, name="rig_pid", units=units)
    text = exported.header.read_text()
    for word in (
        "command is given: 5.",
        "3 not_finite",
        "pressure_1, Pa",
        "angle now, rad",
        "valve, V",
        "integral",
        "0.002",
    ):
        assert word in text
    assert (
        f"#define RIG_PID_STATES {len(flat(Guarded(law).initial_state((0.5, 3e5, 3e5))))}" in text
    )


def test_header_tells_what_people_read_a_unit_in(tmp_path: Path) -> None:
    barn = machine(
        lambda m: {"gas": 1e-6 - m.u.fan * m.x.gas},
        "gas 1 4e-4 scale=1e-3",
        "fan 1/s 0 0.2 0.01 display_unit=1/h",
        "gas 1 1e-6 display_unit=ppm",
    )
    law = design_plain_pid(linearise(operating_point(barn)))
    text = export_c(law, tmp_path, name="barn", units=barn).header.read_text()
    assert "[0] gas, a plain number: 1 ppm is 1e-06" in text
    assert "gas now, a plain number: 1 ppm is 1e-06" in text
    assert "[0] fan, 1/s: 1 1/h is 0.000277778" in text
    # A guard for a plant knows them.
    export_c(guarded(law, barn), tmp_path, name="held")
    assert "[0] gas, a plain number: 1 ppm is 1e-06" in (tmp_path / "held.h").read_text()


def test_header_of_an_mpc_says_what_can_happen(linear: LinearModel, tmp_path: Path) -> None:
    mpc = design_mpc(linear, MPCSpecification(preview=True))
    exported = export_c(mpc, tmp_path, name="rig_mpc")
    text = " ".join(exported.header.read_text().replace("\n *", "\n").split())
    for words in (
        "12 variables",
        "At most 163 iterations",
        "0 solved, 1 given up after too many iterations, 2 constraints that contradict each other",
        "bytes static",
        "the unconstrained regulator",
        "slack: largest limited output out of its limits",
        "up to 200 samples ahead",
        "#define RIG_MPC_REFERENCES 201",
        "double *command, double *report);",
    ):
        assert words in text


def test_stated_memory_is_what_the_compiler_reserves(
    schedule: JointSchedule, linear: LinearModel, tmp_path: Path
) -> None:
    for name in ("scheduled MPC", "linear MPC"):
        folder = tmp_path / name.replace(" ", "_")
        exported = export_c(MPCS[name](schedule, linear), folder, name="law")
        built(exported)
        stated = re.search(r"(\d+) bytes static", exported.header.read_text())
        tool = shutil.which("size")
        if tool is None:
            pytest.skip("no binutils on this machine")
        thing = exported.source.with_suffix(".o")
        subprocess.run([str(compiler()), "-c", str(exported.source), "-o", str(thing)], check=True)
        shown = subprocess.run([tool, str(thing)], capture_output=True, text=True, check=True)
        data, bss = (int(word) for word in shown.stdout.splitlines()[1].split()[1:3])
        # The compiler aligns each of some thirty arrays to 32 bytes.
        assert stated is not None
        assert int(stated[1]) <= data + bss <= int(stated[1]) + 1000


def test_refusals(linear: LinearModel, schedule: JointSchedule, tmp_path: Path) -> None:
    class Unwritten:
        name, sensors, controlled, actuators = "rule of thumb", ("angle",), ("angle",), ("valve",)
        sample_time, preview = 0.002, 0
        initial_state = step = linear_command = None

    with pytest.raises(WorkbenchError, match="TransferFunction, .*transfer_controller in"):
        export_c(ct.tf([1.0], [1.0, 1.0]), tmp_path)
    with pytest.raises(WorkbenchError, match="'rule of thumb' cannot be written as C"):
        export_c(Unwritten(), tmp_path)  # type: ignore[arg-type]

    class Nonlinear(Unwritten):
        not_in_c = "its prediction is a nonlinear model"

    with pytest.raises(WorkbenchError, match="its prediction is a nonlinear model"):
        export_c(Nonlinear(), tmp_path)  # type: ignore[arg-type]
    with pytest.raises(WorkbenchError, match="small letters"):
        export_c(design_scheduled_pid(schedule), tmp_path, name="My PID")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["mpc", "guard"])
def test_no_name_is_one_of_the_code_inside(name: str, linear: LinearModel, tmp_path: Path) -> None:
    built(export_c(design_mpc(linear), tmp_path, name=name))
