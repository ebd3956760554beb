"""A place that no law explains, told beside parameters of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from tests.diagnosis.example_diagnosis import example_diagnosis, example_task
from tests.machines import machine
from workbench.diagnosis import diagnose as engine
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated_recording
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.selection.selected import Selected
from workbench.errors import WorkbenchError
from workbench.model import Model, Scope
from workbench.physics.library import library
from workbench.recordings.recording import Recording

TRUE = {"wall_capacity": 26e3, "contact": 22.0, "melt_capacity": 3200.0}


def _barrel(*, sheared: bool) -> Model:
    """Return a heated wall and the melt in it, which a screw may shear."""

    def equations(m: Scope) -> dict[str, Any]:
        given = m.p.contact * (m.x.wall - m.x.melt)
        shear = m.u.shear if sheared else 0.0
        return {
            "wall": (3e3 * m.u.heat - given - 5.0 * m.x.wall) / m.p.wall_capacity,
            "melt": (given + shear) / m.p.melt_capacity - 2e-3 * m.x.melt,
        }

    return machine(
        equations,
        "wall K scale=100, melt K scale=100",
        "heat 1 0 1, shear W scale=1e3" if sheared else "heat 1 0 1",
        "wall K 0.05 scale=100, melt K 0.05 scale=100",
        "wall_capacity J/K 20e3 2e3 2e5, contact W/K 15 1.5 150, melt_capacity J/K 4e3 400 4e4",
    )


def _runs() -> list[Recording]:
    runs = []
    for seed in (1, 2):
        heat = 0.5 + pushes(500, largest=0.5, hold=30, seed=seed)
        shear = 800.0 + pushes(500, largest=800.0, hold=45, seed=seed + 9)
        made = simulated_recording(
            _barrel(sheared=True), np.column_stack([heat, shear]), sample_time=5.0, values=TRUE,
            seed=seed, name=f"{seed}",
        )  # fmt: skip
        kept = tuple(s for s in made.signals if s.name != "shear")
        runs.append(replace(made, signals=kept))
    return runs


@pytest.mark.long
def test_a_heat_that_nobody_reads_is_located_beside_right_parameters() -> None:
    model, runs = _barrel(sheared=False), _runs()
    few = [e for e in library(model) if e.law == "overflow"]
    found = diagnose(model, runs[:1], runs[1:], entries=few, jobs=1, advise=False)
    assert found.verdict.kind == "unexplained"
    assert found.verdict.findings[0].where == ("melt.rate",)
    values = {e.name: e.value for e in found.base.refit.estimates}
    for name in ("wall_capacity", "contact"):
        assert values[name] == pytest.approx(TRUE[name], rel=0.05)


@pytest.mark.long
def test_a_curve_without_a_name_is_looked_for_where_all_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given, task = example_diagnosis(), example_task()
    port = given.nominal.ports[0]
    task.__dict__["one_place"] = Location({port.group: 1.0}), given.base
    ports = Mock(side_effect=WorkbenchError("asked"))
    monkeypatch.setattr(engine, "nonparametric_term", ports)
    nothing = Selected(given.base, task.priors)
    engine._without_name(task, replace(given, located=None), nothing)
    assert port.name in ports.call_args.args[3]
