"""Accepts the results of a study as the baseline of the next."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError
from workbench.study.baseline import (
    Baseline,
    changes,
    read_baseline,
    write_baseline,
)
from workbench.study.tasks import record_from_table
from workbench.verification import Tolerance
from workbench.verification.metrics import tolerance_of


def bless(folder: str | Path, baseline: str | Path) -> str:
    """Write the results in a folder as a baseline.

    Args:
        folder: Folder of results.
        baseline: File to write.

    Returns:
        In words, what changes against the file that was there.

    Raises:
        WorkbenchError: If there are no results, or the baseline is of another study or cannot be
            written.

    Example:
        >>> bless.__name__
        'bless'
    """
    path = Path(folder) / "results.json"
    table = _results(path)
    place = Path(baseline)
    try:
        records = [record_from_table(row) for row in table["runs"]]
    except (KeyError, TypeError, ValueError):
        raise WorkbenchError(f"results {str(path)!r} are incomplete; run the study again") from None
    study = str(table["study"])
    before = read_baseline(place) if place.exists() else Baseline({}, study, place)
    if before.study not in ("", study):
        raise WorkbenchError(
            f"{str(place)!r} is the baseline of study {before.study!r}, the results are of"
            f" {study!r}; give another file"
        )
    own = {name: Tolerance(**given) for name, given in table.get("tolerances", {}).items()}
    known = [*records, *before.records.values()]
    names = dict.fromkeys(name for r in known if r.metrics for name in r.metrics)
    rules = {name: own.get(name) or tolerance_of(name) for name in names}
    found = changes(rules, records, before)
    failed = [r for r in records if r.failed]
    write_baseline(place, study, records)
    lines = []
    if not before.records:
        lines.append(f"accepted {len(records)} runs of study {study} as the first baseline")
    elif not found:
        lines.append(f"nothing changed beyond its tolerance; {len(records)} runs written")
    else:
        counts = {way: sum(c.way == way for c in found) for way in ("worse", "better")}
        rest = len(found) - sum(counts.values())
        lines.append(
            f"accepted {len(found)} changes: {counts['worse']} worse, {counts['better']} better,"
            f" {rest} other"
        )
        lines += [f"  {change}" for change in found]
    if failed:
        lines.append(f"{len(failed)} failed runs are accepted as failed; a study with them fails")
    missed = [r for r in table.get("requirements", ()) if r["hard"] and not r["met"]]
    if missed:
        lines.append(
            f"{len(missed)} hard requirements are missed; a baseline accepts changes, not failures,"
            " so the study still fails"
        )
    return "\n".join([*lines, f"written to {place}"])


def _results(path: Path) -> dict[str, Any]:
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise WorkbenchError(
            f"results {str(path)!r} cannot be read: {reason}; write them with 'workbench compare'"
        ) from None
    except ValueError:
        table = None
    if not isinstance(table, dict) or table.get("kind") != "workbench results":
        raise WorkbenchError(f"{str(path)!r} holds no results of 'workbench compare'")
    return table
