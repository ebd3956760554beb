"""Whether one more experiment turns a class of look-alikes into a name.

Cases are recorded so poorly that many end as a class: short, in the loop, along slow sines of a few
degrees. On each that does, what the tool proposes to record next is played on the rig for 20 s, and
the tool judges again with it.

Units: SI.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.diagnosis.experiment.menu import Experiment
from workbench.diagnosis.experiment.run_on_machine import with_experiment
from workbench.diagnosis.stages import Diagnosis
from workbench.errors import check_range
from workbench.evaluation.blind_round import Line, answer_of, score_case
from workbench.evaluation.kept_answers import answered, chosen_cases, diagnosed, silent, version
from workbench.evaluation.own_cases.own_case import made
from workbench.evaluation.own_cases.plan import POORLY_SEEN, Planned, names, plan
from workbench.evaluation.own_cases.statistics import truths_of
from workbench.evaluation.rates import Rate
from workbench.evaluation.rig import simulate
from workbench.evaluation.rig.cases import settled
from workbench.evaluation.rig.excitation import RATE
from workbench.recordings import read_case
from workbench.recordings.recording import Recording, Signal


@dataclass(frozen=True)
class RigMachine:
    """The rig with what it hides."""

    parameters: dict[str, float] = field(repr=False)

    def play(self, experiment: Experiment) -> Recording:
        """Play the inputs of an experiment from rest at 30 degrees."""
        check_range("sample time", experiment.sample_time, 0.999 / RATE, 1.001 / RATE, "s")
        start = settled(self.parameters, seconds=2.0)
        record = simulate.run(self.parameters, start, command=experiment.inputs[:, 0], seed=1)
        return recording_of(record, "experiment")


def recording_of(record: simulate.Record, name: str) -> Recording:
    """Return a record of the rig in SI."""
    signals = (
        Signal("valve", record.valve, "V", role="command"),
        Signal("angle", np.radians(record.angle), "rad"),
        Signal("pressure_1", 1e5 * record.pressure_1, "Pa"),
        Signal("pressure_2", 1e5 * record.pressure_2, "Pa"),
    )
    return Recording(name, record.time, signals)


SCHEMA = "experiment_case/1"

FIRST_SEED = 40000
"""Seed of the first case unless another is given."""

SECONDS = 10.0
"""Length of the recordings that there are before the experiment, s."""


def poor_cases(first_seed: int | None = None) -> tuple[Planned, ...]:
    """Return cases of effects that something resembles, recorded along slow sines in the loop."""
    single = {
        c.effects[0]: c
        for c in plan(FIRST_SEED if first_seed is None else first_seed)
        if c.kind == "single" and c.factor == 1.0 and "pressure_noise_time" not in c.changes
    }
    return tuple(replace(single[name], recorded="narrow") for name in POORLY_SEEN)


def run_experiments(
    out: Path,
    count: int,
    first_seed: int | None,
    part: tuple[int, int],
    only: Sequence[str],
    *,
    jobs: int,
    dask: str | None,
) -> Iterator[str]:
    """Diagnose poorly recorded cases until ``count`` ended as classes, each with one experiment.

    Yields one line per case, then the table; answers are kept as `answered` keeps them, and those
    of other parts count too.
    """
    cases = poor_cases(first_seed)
    for case in chosen_cases(cases, part, only):
        if sum("after" in row for row in _kept(cases, out)) >= count:
            break
        yield from map(line_of, answered([case], out, answer, jobs=jobs, dask=dask))
    yield table(_kept(cases, out))


def _kept(cases: Sequence[Planned], out: Path) -> list[dict[str, Any]]:
    paths = [out / f"{case.name}.json" for case in cases]
    return [json.loads(path.read_text()) for path in paths if path.exists()]


def answer(case: Planned, jobs: int) -> dict[str, Any]:
    """Diagnose one case and, if it ends as a class, play what is proposed and diagnose again."""
    with tempfile.TemporaryDirectory() as place:
        folder = made(case, Path(place) / case.name, seconds=SECONDS)
        found = read_case(folder)
        plant, fit, hold_out = found.model(), found.fit.values(), found.hold_out.values()
        row: dict[str, Any] = {"schema": SCHEMA, "case": case.name, "title": case.title}
        row |= {"effects": list(case.effects), "version": version()}
        rig = RigMachine(json.loads((folder / "truth.json").read_text())["parameters"])

        def again(first: Diagnosis) -> dict[str, Any]:
            plan_ = first.validated.plan if first.validated else None
            if plan_ is None or not is_class(first.verdict.as_data()):
                return {}
            try:
                runs = with_experiment(plant, plan_, rig, tuple(fit), tuple(hold_out))
            except Exception as error:  # noqa: BLE001
                after = silent("failed", error)
            else:
                after = diagnosed({}, plant, *runs[1:], jobs=jobs)["verdict"]
            return {"experiment": plan_.text, "after": after}

        return diagnosed(
            row, plant, tuple(fit), tuple(hold_out), jobs=jobs, advise=True, more=again
        )


def is_class(verdict: Mapping[str, Any]) -> bool:
    """Return whether a verdict leaves look-alikes for anything that it found."""
    return any(len(finding["class"]) > 1 for finding in verdict["findings"])


def is_name(verdict: Mapping[str, Any]) -> bool:
    """Return whether a verdict names all that it found."""
    found = verdict["findings"]
    return bool(found) and all(f["effect"] and len(f["class"]) == 1 for f in found)


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a kept case."""
    said = [_judged(row, row["verdict"]).said]
    if "after" in row:
        after = _judged(row, row["after"])
        said += [f"[{row['experiment']}]", f"{after.said} ({after.remark})"]
    return f"{row['case']} {row['title']:<30} {' -> '.join(said)}"


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return how many classes became names, right ones among them, as text."""
    played = [row for row in rows if "after" in row]
    named = [row for row in played if is_name(row["after"])]
    right = [row for row in named if "wrong" not in _judged(row, row["after"]).remark]
    return (
        f"{len(rows)} cases, {len(played)} ended as classes and got an experiment\n"
        f"became a name        {Rate(len(named), len(played))}\n"
        f"became a right name  {Rate(len(right), len(played))}"
    )


def _judged(row: Mapping[str, Any], verdict: Mapping[str, Any]) -> Line:
    return score_case(answer_of(verdict, row["case"], names()), truths_of(row))
