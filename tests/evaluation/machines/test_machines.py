"""Real machines: tasks are complete, first models run, results are held against the table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.diagnosis.estimation.free_run import free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.evaluation.machines import real_machine as machines
from workbench.evaluation.machines.plants import axis, axis_in_loop, muscle, pendulum, piston, tanks
from workbench.model import Model


@pytest.mark.parametrize(
    "model", [axis(), axis_in_loop(), tanks(), piston(), pendulum(), muscle()], ids=lambda m: m.name
)
def test_first_models_have_finite_rates_and_something_to_fit(model: Model) -> None:
    assert np.all(np.isfinite(model.rates(model.initial_state(), model.nominal_input)))
    assert any(q.fitted for q in model.parameters)
    dry = {"coulomb_friction", "stribeck_friction", "gear_friction"}
    assert not dry & {effect.name for effect in model.effects}


def test_a_force_map_is_held_point_by_point(tmp_path: Path) -> None:
    model = muscle(0.3, 0.01)
    rows = ["pressure_Pa,length_m,force_N"]
    for pressure in (2e5, 4e5, 6e5):
        for length in (0.30, 0.29, 0.28, 0.27):
            cell = model.rates([0.0], [pressure, 0.3 - length])[0] * 0.01
            rows.append(f"{pressure:.0f},{length:.3f},{cell:.3f}")
    rows.append("50000,0.270,0")
    file = tmp_path / "map.csv"
    file.write_text("\n".join(rows) + "\n")
    (fitted,), (judged,) = machines._map_recordings(file, 0.3)
    # One inner length is judged on, at three pressures of four samples; a slack point is left out.
    assert (len(fitted), len(judged)) == (36, 12)
    assert np.unique(judged["contraction"]).round(4).tolist() == [0.02]
    # The model that made the map gives it back, but for what the cell has not settled.
    error = free_run(model, observe(model, judged)).rmse["force"]
    assert error < 1e-3 * np.ptp(fitted["force"])


def row(machine: str, *names: str, held_out: float | None = None) -> dict[str, Any]:
    """A kept result."""
    findings = [{"effect": name, "where": [], "class": [name]} for name in names]
    verdict = {"verdict": "named", "findings": findings}
    errors = {} if held_out is None else {"refitted": 2 * held_out, "extended": held_out}
    return {"machine": machine, "verdict": verdict, "held_out": errors, "seconds": 1.0}


@pytest.mark.parametrize(
    ("kept", "lacking"),
    [
        (row("emps", "coulomb_friction", "constant_force", held_out=2e-3), []),
        (row("emps", "coulomb_friction", held_out=5e-3),
         ["no constant_force or offset", "more than 3.96 mm"]),
        (row("pendulum", "stribeck_friction", held_out=0.05),
         ["no load_dependent_friction", "stribeck_friction named alone"]),
        (row("napn", "coulomb_friction", "load_dependent_friction"),
         ["load_dependent_friction named"]),
        (row("tanks"), ["no overflow", "more than 0.30 V"]),
    ],
)  # fmt: skip
def test_a_result_is_held_against_the_table(kept: dict[str, Any], lacking: list[str]) -> None:
    assert machines.shortfalls(kept) == lacking
    line = machines.line_of(kept)
    assert line.startswith(kept["machine"]) and (lacking or "reached" in line)


def test_the_table_names_a_case_or_a_map_for_each_machine() -> None:
    for name, entry in machines.table().items():
        if "map" in entry:
            continue
        assert (machines.HERE / entry["case"] / "case.toml").is_file(), name
