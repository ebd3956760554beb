"""Accepts the results of a study as the baseline of the next."""

from __future__ import annotations

from pathlib import Path

from workbench.checked_json import TableShape, flag, listed, named, one_of, read_json, text
from workbench.errors import WorkbenchError
from workbench.study.baseline import (
    BOX,
    CONDITIONS,
    RESULTS_KIND,
    TOLERANCE,
    Baseline,
    box_changes,
    changes,
    read_baseline,
    records_of,
    write_baseline,
)
from workbench.study.conditions import condition_changes
from workbench.study.tasks import RECORD
from workbench.verification import Tolerance
from workbench.verification.metrics import tolerance_of

_RESULTS = TableShape(
    {
        "kind": one_of(RESULTS_KIND),
        "study": text,
        "runs": listed(RECORD),
        "conditions": CONDITIONS,
    },
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
        counts = {way: sum(c.way == way for c in found) for way in ("worse", "better")}
        rest = len(found) - sum(counts.values())
        lines.append(
            f"accepted {len(found)} changes: {counts['worse']} worse, {counts['better']} better,"
            f" {rest} other"
        )
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
