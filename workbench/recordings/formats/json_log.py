"""Read JSON logs: a list of entries with the same keys, or one list per key."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns
from workbench.recordings.formats.delimited_text import cell_text, is_number, read_cells
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.instants import NEVER, instant
from workbench.recordings.formats.variables import flatten, taken_apart

_MAX_BYTES = 500_000_000


def _load(file: Path) -> Any:
    try:
        if file.stat().st_size > _MAX_BYTES:
            raise WorkbenchError(
                f"{file.name} is larger than {_MAX_BYTES // 10**6} MB, too much for a JSON log; "
                "write it as CSV or Parquet, which are read in pieces"
            )
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise WorkbenchError(f"{file.name} is not a JSON text (it is not UTF-8)") from None
    damage = (ValueError, RecursionError)
    with taken_apart(file, "JSON", damage):
        try:
            return json.loads(text)
        except damage:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) > 1 and lines[0].lstrip().startswith("{"):
                with suppress(*damage):
                    return [json.loads(line) for line in lines]
            raise


def _entries(content: Any) -> tuple[Sequence[Mapping[str, Any]], dict[str, Any]]:
    """Return the list of entries and what stands beside it."""
    if isinstance(content, list):
        return [e for e in content if isinstance(e, Mapping)], {}
    if not isinstance(content, Mapping):
        return [], {}
    logs = {
        k: v
        for k, v in content.items()
        if isinstance(v, list) and v and all(isinstance(e, Mapping) for e in v)
    }
    if logs:
        longest = max(logs, key=lambda k: len(logs[k]))
        return logs[longest], {k: v for k, v in content.items() if k not in logs}
    lists = {k: v for k, v in content.items() if isinstance(v, list) and len(v) > 1}
    if lists:
        sizes = [len(v) for v in lists.values()]
        size = max(set(sizes), key=sizes.count)
        lists = {k: v for k, v in lists.items() if len(v) == size}
        rows = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
        return rows, {k: v for k, v in content.items() if k not in lists}
    return [], {}


def read_json(path: Path, options: ReadOptions) -> Columns:
    """Read a list of entries with the same keys, one list per key, or one entry per line.

    The longest list inside an object counts; the object's other scalars become settings. What an
    entry holds in objects and lists of its own is called ``object.key`` and ``list.1``.
    """
    entries, beside = _entries(_load(path))
    if len(entries) < 2:
        raise WorkbenchError(
            f"{path.name} holds no list of entries with the same keys, as a log has; it holds "
            f"{len(entries)} entry"
        )
    rows: list[dict[str, Any]] = [{} for _ in entries]
    for entry, row in zip(entries, rows, strict=True):
        for key, value in entry.items():
            flatten(str(key), value, row)
    keys = list(dict.fromkeys(key for row in rows for key in row))[:1000]
    cells = {key: [cell_text(row.get(key)) for row in rows] for key in keys}
    kept = {k: v for k, v in cells.items() if any(is_number(c) or instant(c) != NEVER for c in v)}
    if not kept:
        raise WorkbenchError(f"the entries of {path.name} hold no numbers")
    titles = [" ".join(key.split()) for key in kept]
    found = read_cells(path, [titles, *zip(*kept.values(), strict=True)], options)
    settings = {str(k): v for k, v in beside.items() if isinstance(v, (str, int, float, bool))}
    skipped = [key for key in keys if key not in kept]
    notes = [f"left out, no numbers: {', '.join(skipped)}"] if skipped else []
    # Above the first entry stands a line of keys.
    unreadable = {
        key: (count, re.sub(r"line (\d+)$", lambda m: f"entry {int(m[1]) - 1}", text))
        for key, (count, text) in found.unreadable.items()
    }
    return replace(
        found,
        metadata={**found.metadata, **settings},
        notes=(*notes, *found.notes),
        unreadable=unreadable,
    )


JSON = Format("json", "JSON", (".json", ".jsonl", ".ndjson"), read_json)
