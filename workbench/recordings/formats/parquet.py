"""Read Parquet files with pyarrow, batch by batch."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns, Thinner
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.variables import taken_apart
from workbench.recordings.recording import Scalar


def read_parquet(path: Path, options: ReadOptions) -> Columns:
    """Read the columns of numbers, of instants in s from the first one, and of durations in s."""
    import pyarrow as pa
    import pyarrow.parquet

    numeric = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean)
    # pyarrow raises OSError, its own errors or ValueError on damaged files.
    with taken_apart(path, "a Parquet file", (OSError, ValueError, pa.ArrowException)):
        source = pa.parquet.ParquetFile(path)
        schema = source.schema_arrow
        names = [f.name for f in schema if any(test(f.type) for test in numeric)]
        stamps = [f.name for f in schema if pa.types.is_timestamp(f.type)]
        spans = [f.name for f in schema if pa.types.is_duration(f.type)]
        thinner = Thinner(options.max_rows)
        start: Any = None
        for batch in source.iter_batches(batch_size=65536, columns=names + stamps + spans):
            cells = [
                # Nanoseconds since 1970 have more digits than a double: the last few do not count.
                batch.column(n).cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
                for n in names
            ]
            for n in stamps:
                raw = batch.column(n).cast(pa.timestamp("ns")).to_numpy(zero_copy_only=False)
                start = raw[0] if start is None else start
                cells.append((raw - start) / np.timedelta64(1, "s"))
            for n in spans:
                raw = batch.column(n).cast(pa.duration("ns")).to_numpy(zero_copy_only=False)
                cells.append(raw / np.timedelta64(1, "s"))
            if cells:
                thinner.add(np.column_stack(cells).astype(float))
        metadata = _metadata(schema)
    values = thinner.rows()
    if not (names or stamps or spans) or len(values) == 0:
        raise WorkbenchError(f"{path.name} holds no columns of numbers")
    values[~np.isfinite(values)] = np.nan
    left = [f.name for f in schema if f.name not in names + stamps + spans]
    notes = [f"left out, not columns of numbers: {', '.join(left)}"] if left else []
    notes += thinner.notes
    headers = (*names, *(f"{n} [s]" for n in stamps + spans))
    return Columns(headers, ("",) * len(headers), values, True, metadata, tuple(notes))


def _metadata(schema: Any) -> dict[str, Scalar]:
    out: dict[str, Scalar] = {}
    for key, value in (schema.metadata or {}).items():
        name = key.decode("utf-8", "replace")
        if name in ("pandas", "ARROW:schema"):
            continue
        text = value.decode("utf-8", "replace")
        try:
            decoded = json.loads(text)
        except (json.JSONDecodeError, RecursionError):
            decoded = text
        out[name] = decoded if isinstance(decoded, (str, int, float, bool)) else text
    return out


PARQUET = Format("parquet", "Parquet", (".parquet", ".pq"), read_parquet, extra="parquet")
