"""Comparison with a stored baseline, and its acceptance: what changed beyond its tolerance."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from workbench.checked_json import (
    Place,
    TableShape,
    anything,
    flag,
    listed,
    named,
    number,
    one_of,
    read_json,
    text,
    whole,
)
from workbench.errors import WorkbenchError
from workbench.files import write_whole
from workbench.model.units import convert, same_dimension, with_unit
from workbench.study.conditions import condition_changes
from workbench.study.tasks import RECORD, Record, record_from_table
from workbench.verification import Metric, MetricValue, Tolerance
from workbench.verification.metrics import metric_of, tolerance_of

BASELINE_SCHEMA = 2
"""Version of a baseline."""

KIND = "workbench baseline"
RESULTS_KIND = "workbench results"
RUN_FAILED = "it failed"
"""How the reason of a change begins that is a failed run."""

Way = Literal["worse", "better", "changed", "new", "gone"]
Key = tuple[str, str, str, int]


@dataclass(frozen=True)
class Change:
    """A metric of a run that differs from the baseline by more than its tolerance.

    Args:
        key: Controller, variation, scenario and seed of the run.
        before: Value of the baseline, in ``unit``; NaN if there was none.
        after: Value now, in ``unit``; NaN if there is none.
        way: ``"worse"``, ``"better"``, ``"changed"`` where neither direction is better, ``"new"``
            or ``"gone"``.
        tolerance: Difference that would not have counted, in ``unit``.
    """

    key: Key
    metric: str
    before: float
    after: float
    unit: str
    way: Way
    gates: bool
    tolerance: float = 0.0
    reason: str = ""

    @property
    def fails(self) -> bool:
        """Whether the change fails the study."""
        return self.gates and self.way in ("worse", "gone")

    @property
    def failed(self) -> bool:
        """Whether it is worse because the run failed, which is told with the failed runs."""
        return self.reason.startswith(RUN_FAILED)

    def numbers(self) -> str:
        """Return both values with their unit."""
        old, new = ("none" if math.isnan(v) else f"{v:.4g}" for v in (self.before, self.after))
        return f"{old} -> {new if math.isnan(self.after) else with_unit(new, self.unit)}"

    def __str__(self) -> str:
        controller, variation, scenario, _ = self.key
        where = ", ".join(filter(None, (controller, scenario, variation)))
        tail = f" ({self.reason})" if self.reason else ""
        if not self.metric:
            return f"{where}: run is {self.way}{tail}"
        if not tail:
            tail = f" (tolerance {with_unit(f'{self.tolerance:.2g}', self.unit)})"
        if self.way == "worse" and not self.gates:
            tail += ", which does not count against it"
        return f"{where}: {self.metric} {self.numbers()}, {self.way}{tail}"


@dataclass(frozen=True)
class Baseline:
    """Stored runs.

    Args:
        conditions: What was required, and under which conditions; none of runs alone.
        box: What the parameter box did to each controller, as `BOX` has it; empty if it was not
            kept.
    """

    records: Mapping[Key, Record]
    study: str
    path: Path
    conditions: Mapping[str, Any] = field(default_factory=dict)
    box: Sequence[Mapping[str, Any]] = ()


def read_baseline(path: str | Path, *, of: str = "") -> Baseline:
    """Read a baseline, or the ``results.json`` of a study.

    Args:
        of: Name of the study that is compared with it: one of another study, or one without runs,
            would let everything pass.
    """
    place = Path(path)
    fix = f"write one with 'workbench bless DIR --baseline {place}'"
    table = read_json(place, "baseline", _BASELINE, fix=fix)
    if table.get("kind", KIND) == RESULTS_KIND:
        table["schema"] = BASELINE_SCHEMA
    if table["schema"] != BASELINE_SCHEMA:
        raise WorkbenchError(
            f"baseline {str(place)!r} has schema {table['schema']!r}; this version reads"
            f" {BASELINE_SCHEMA}; {fix}"
        )
    study = table.get("study", "")
    if of and study not in ("", of):
        raise WorkbenchError(
            f"baseline {str(place)!r} is that of study {study!r}, and compared is {of!r}; {fix}"
        )
    if of and not table["runs"]:
        raise WorkbenchError(f"baseline {str(place)!r} holds no runs to compare with; {fix}")
    return Baseline(
        records_of(table["runs"], f"baseline {str(place)!r}"),
        study,
        place,
        table["conditions"],
        table.get("box", table.get("robustness", ())),
    )


def records_of(rows: Iterable[Mapping[str, Any]], what: str) -> dict[Key, Record]:
    """Return the records that checked tables describe."""
    found: dict[Key, Record] = {}
    for row in rows:
        record = record_from_table(row)
        name = ", ".join(map(str, record.key))
        if record.key in found:
            raise WorkbenchError(f"{what} has the run {name} twice; write it anew")
        for metric in record.metrics.values if record.metrics else ():
            try:
                metric.shown()
            except WorkbenchError as error:
                raise WorkbenchError(f"{what}, {name}, {metric.name}: {error}") from None
        found[record.key] = record
    return found


def _box_entry(value: Any, place: Place) -> Any:
    if isinstance(value, dict):
        return TableShape({"low": number, "high": number})(value, place)
    if isinstance(value, list):
        return listed(text)(value, place)
    return value if isinstance(value, bool) else whole(value, place)


TOLERANCE = TableShape(
    {},
    {"better": one_of("less", "more", "neither"), "gates": flag, "repeats": flag}
    | dict.fromkeys(("absolute", "typical", "relative"), number),
)
"""Shape of a rule of comparison in a file."""

CONDITIONS = TableShape(
    {},
    {
        "requirements": named(
            TableShape(
                {"limit": number, "unit": text, "hard": flag, "weight": number}
                | {"kind": one_of("at_most", "at_least")}
            )
        ),
        "scenarios": named(named(anything)),
        "variations": named(named(anything)),
        "box": named(_box_entry),
        "tolerances": named(TOLERANCE),
        "unjudged": named(flag),
    },
)
"""Shape of the conditions in a file."""

_MET = TableShape({"requirement": text, "hard": flag, "met": whole, "draws": whole})
BOX = listed(TableShape({"controller": text, "worst_score": number, "requirements": listed(_MET)}))
"""Shape of what a parameter box did, in a file."""

_BASELINE = TableShape(
    {"schema": whole, "runs": listed(RECORD), "conditions": CONDITIONS},
    {"study": text, "kind": one_of(KIND, RESULTS_KIND), "box": BOX, "robustness": BOX},
)


def baseline_text(
    study: str,
    records: Iterable[Record],
    conditions: Mapping[str, Any],
    box: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Return a baseline as JSON that changes only where numbers do.

    A line per metric, runs sorted, numbers to 9 digits, nothing that differs from machine to
    machine.
    """
    runs = []
    for record in sorted(records, key=lambda r: r.key):
        table = record.table()
        del table["seconds"], table["steps"]
        table["metrics"] = {
            name: {key: _nine_digits(word) for key, word in metric.items() if word != ""}
            for name, metric in table.pop("metrics").items()
            if not name.startswith("solve_time")
        }
        runs.append(table)
    kept = {"kind": KIND, "schema": BASELINE_SCHEMA, "study": study, "conditions": conditions}
    if box:
        kept["box"] = [_box_row(row) for row in box]
    return _in_lines(kept | {"runs": runs}, 4) + "\n"


def write_baseline(
    path: str | Path,
    study: str,
    records: Iterable[Record],
    conditions: Mapping[str, Any],
    box: Sequence[Mapping[str, Any]] = (),
) -> Path:
    """Write a baseline."""
    return write_whole(path, baseline_text(study, records, conditions, box))


def _in_lines(value: Any, depth: int) -> str:
    """Return JSON with a line per entry of the outer levels, whose innermost stay on one."""
    inside = value.values() if isinstance(value, Mapping) else value
    if (
        not depth
        or not isinstance(value, Mapping | list)
        or not any(isinstance(one, Mapping | list) for one in inside)
    ):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list):
        return "[\n" + ",\n".join(_in_lines(one, depth - 1) for one in value) + "\n]"
    entries = (f"{json.dumps(key)}: {_in_lines(one, depth - 1)}" for key, one in value.items())
    return "{\n" + ",\n".join(entries) + "\n}"


def _nine_digits(value: Any) -> Any:
    return float(f"{value:.9g}") if isinstance(value, float) else value


def _box_row(row: Mapping[str, Any]) -> dict[str, Any]:
    kept = ("requirement", "hard", "met", "draws")
    return {
        "controller": row["controller"],
        "worst_score": _nine_digits(row["worst_score"]),
        "requirements": [{key: own[key] for key in kept} for own in row["requirements"]],
    }


def changes(
    rules: Mapping[str, Tolerance], records: Iterable[Record], baseline: Baseline
) -> tuple[Change, ...]:
    """Compare runs with a baseline.

    Of a run with a sliding surface only the invariants fail a study: when the surface is crossed
    depends on rounding, how far the trajectory strays from it does not.
    """
    found: list[Change] = []
    gone = dict.fromkeys(baseline.records)
    for record in records:
        gone.pop(record.key, None)
        before = baseline.records.get(record.key)
        if before is None:
            found.append(_whole(record.key, "new", "the baseline has no such run"))
        elif record.failed and not before.failed:
            found.append(_whole(record.key, "worse", f"{RUN_FAILED}: {record.reason}"))
        elif before.failed and not record.failed:
            found.append(_whole(record.key, "better", "it failed in the baseline"))
        elif not record.failed:
            found += _metrics(rules, before, record)
    return (
        *found,
        *(_whole(key, "gone", "the baseline has it, the study has not") for key in gone),
    )


def box_changes(rows: Iterable[Mapping[str, Any]], baseline: Baseline) -> tuple[Change, ...]:
    """Compare how many plants of the parameter box meet each requirement."""
    before = {
        (row["controller"], own["requirement"]): own
        for row in baseline.box
        for own in row["requirements"]
    }
    found = []
    for row in rows:
        for own in row["requirements"]:
            old = before.get((row["controller"], own["requirement"]))
            if old is None or not old["draws"] or not own["draws"]:
                continue
            was, now = (100.0 * part["met"] / part["draws"] for part in (old, own))
            if not math.isclose(was, now):
                key = (row["controller"], IN_BOX, "", 0)
                name = f"plants that meet {own['requirement']}"
                way: Way = "worse" if now < was else "better"
                found.append(Change(key, name, was, now, "%", way, own["hard"]))
    return tuple(found)


IN_BOX = "box"
"""What stands in the place of a variation where the parameter box is meant."""


def _whole(key: Key, way: Way, reason: str) -> Change:
    return Change(key, "", math.nan, math.nan, "1", way, way in ("worse", "gone"), 0.0, reason)


def _metrics(rules: Mapping[str, Tolerance], before: Record, after: Record) -> list[Change]:
    was, now = before.metrics, after.metrics
    assert was is not None and now is not None
    sliding = any(_known(name).needs == "surface" for name in now)
    found = []
    for name in dict.fromkeys((*now, *was)):
        own = rules[name]
        if not own.repeats:
            continue
        gates = own.gates and (_known(name).invariant or not sliding)
        old, new = (known[name].value if name in known else math.nan for known in (was, now))
        metric = now[name] if name in now else was[name]
        unit = metric.display_unit or metric.unit
        stored = was[name].unit if name in was else metric.unit
        if stored != metric.unit:
            # Numbers of another unit are no numbers to compare with.
            if not same_dimension(stored, metric.unit):
                reason = f"the baseline has it in {stored!r}"
                values = math.nan, _shown(metric, new)
                found.append(Change(after.key, name, *values, unit, "worse", True, 0.0, reason))
                continue
            old = float(convert(old, stored, metric.unit))
        if math.isnan(old) and math.isnan(new):
            continue
        tolerance = own.absolute + own.relative * (abs(old) if not math.isnan(old) else 0.0)
        way: Way
        if math.isnan(new):
            way = "worse"
        elif math.isnan(old):
            way = "better" if name in was else "new"
        elif abs(new - old) <= tolerance:
            continue
        elif own.better == "neither":
            way = "changed"
        else:
            way = "worse" if (new > old) == (own.better == "less") else "better"
        values = _shown(metric, old), _shown(metric, new)
        allowed, reason = _shown(metric, tolerance), metric.reason if math.isnan(new) else ""
        found.append(Change(after.key, name, *values, unit, way, gates, allowed, reason))
    return found


def _known(name: str) -> Metric:
    return metric_of(name) or Metric(name, lambda run: math.nan)


def _shown(metric: MetricValue, value: float) -> float:
    number, _ = replace(metric, value=value).shown()
    return float(number)


_RESULTS = TableShape(
    {"kind": one_of(RESULTS_KIND), "study": text, "runs": listed(RECORD), "conditions": CONDITIONS},
    {
        "tolerances": named(TOLERANCE),
        "robustness": BOX,
        "requirements": listed(TableShape({"hard": flag, "met": flag})),
    },
)


def bless(folder: str | Path, baseline: str | Path) -> str:
    """Write the results in a folder as a baseline; returns in words what changes."""
    path = Path(folder) / "results.json"
    table = read_json(path, "results", _RESULTS, fix="write them with 'workbench compare'")
    place = Path(baseline)
    records = list(records_of(table["runs"], f"results {str(path)!r}").values())
    study = table["study"]
    before = read_baseline(place) if place.exists() else Baseline({}, study, place)
    if before.study not in ("", study):
        raise WorkbenchError(
            f"{str(place)!r} is the baseline of study {before.study!r}, the results are of"
            f" {study!r}; give another file"
        )
    own = {
        name: Tolerance(**{key: rule[key] for key in Tolerance._fields if key in rule})
        for name, rule in table.get("tolerances", {}).items()
    }
    known = [*records, *before.records.values()]
    names = dict.fromkeys(name for r in known if r.metrics for name in r.metrics)
    rules = {name: own.get(name) or tolerance_of(name) for name in names}
    box = table.get("robustness", ())
    found = (*changes(rules, records, before), *box_changes(box, before))
    failed = [r for r in records if r.failed]
    kept = table["conditions"]
    other = condition_changes(before.conditions, kept) if before.conditions else ()
    write_baseline(place, study, records, kept, box)
    lines = []
    if not before.records:
        lines.append(f"accepted {len(records)} runs of study {study} as the first baseline")
    elif not found and not other:
        lines.append(f"nothing changed beyond its tolerance; {len(records)} runs written")
    else:
        worse, better = (sum(c.way == way for c in found) for way in ("worse", "better"))
        rest = f"{len(found) - worse - better} other"
        lines.append(f"accepted {len(found)} changes: {worse} worse, {better} better, {rest}")
        lines += [f"  {change}" for change in found]
    if other:
        lines.append(f"accepted {len(other)} changed conditions:")
        lines += [f"  {change}" for change in other]
    if failed:
        lines.append(f"{len(failed)} failed runs are accepted as failed; a study with them fails")
    missed = [r for r in table.get("requirements", ()) if r["hard"] and not r["met"]]
    if missed:
        lines.append(
            f"{len(missed)} hard requirements are missed; a baseline accepts changes, not failures,"
            " so the study still fails"
        )
    return "\n".join([*lines, f"written to {place}"])
