"""Read JSON logs: a list of entries with the same keys, or one list per key."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.recording import Scalar

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
    try:
        return json.loads(text)
    except (json.JSONDecodeError, RecursionError, ValueError) as error:
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) > 1 and lines[0].lstrip().startswith("{"):
            try:
                return [json.loads(line) for line in lines]
            except (json.JSONDecodeError, RecursionError, ValueError):
                pass
        raise WorkbenchError(
            f"{file.name} is truncated or not JSON ({str(error)[:80]}); save or copy it again"
        ) from None


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


def _number(cell: Any) -> float | None:
    if isinstance(cell, (bool, int, float)):
        try:
            value = float(cell)
        except OverflowError:
            return None
        return value if np.isfinite(value) else None
    return None


def read_json(path: Path, options: ReadOptions) -> Columns:
    """Read a list of entries with the same keys, one list per key, or one entry per line.

    The longest list inside an object counts; the object's other scalars become settings.
    """
    del options
    entries, beside = _entries(_load(path))
    if len(entries) < 2:
        raise WorkbenchError(
            f"{path.name} holds no list of entries with the same keys, as a log has; it holds "
            f"{len(entries)} entry"
        )
    keys = list(dict.fromkeys(str(k) for e in entries for k in e))[:1000]
    columns, headers, unreadable, skipped = [], [], {}, []
    for key in keys:
        cells = [e.get(key) for e in entries]
        numbers = [_number(c) for c in cells]
        if all(n is None for n in numbers):
            skipped.append(key)
            continue
        bad = [
            i
            for i, (c, n) in enumerate(zip(cells, numbers, strict=True))
            if n is None and c is not None
        ]
        if bad:
            unreadable[key] = (len(bad), f"{str(cells[bad[0]])[:30]!r} in entry {bad[0] + 1}")
        columns.append([np.nan if n is None else n for n in numbers])
        headers.append(key)
    if not columns:
        raise WorkbenchError(f"the entries of {path.name} hold no numbers")
    metadata: dict[str, Scalar] = {
        str(k): v for k, v in beside.items() if isinstance(v, (str, int, float, bool))
    }
    notes = [f"left out, no numbers: {', '.join(skipped)}"] if skipped else []
    return Columns(
        tuple(headers),
        ("",) * len(headers),
        np.array(columns, dtype=float).T,
        True,
        metadata,
        tuple(notes),
        unreadable,
    )


JSON = Format("json", "JSON", (".json", ".jsonl", ".ndjson"), read_json)
