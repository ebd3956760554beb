"""Leave out one piece of the paper's physics after the other: ``python -m tests.left_out OUT``.

Every piece is looked for with the whole library; OUT receives each verdict and ``table.txt``.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from tests.left_out.plan import PLAN
from tests.left_out.run import as_data, run, table


def main(out: Path, jobs: int) -> None:
    """Diagnose every reduced plant and print the table."""
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    for i, case in enumerate(PLAN):
        with tempfile.TemporaryDirectory() as folder:
            row, found = run(case, Path(folder), jobs=jobs)
        rows.append(row)
        assert found.verdict is not None
        kept = {"row": as_data(row), "verdict": found.verdict.as_data()}
        (out / f"{i}-{case.trial}.json").write_text(json.dumps(kept, indent=1))
        sys.stderr.write(f"{row.left_out}, {row.trial}: {row.kind} ({row.seconds:.0f} s)\n")
    (out / "table.txt").write_text(table(rows) + "\n")
    sys.stdout.write(table(rows) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 2)
