"""Make the cases, diagnose them and print the rates: ``python -m tests.own_cases OUT [COUNT]``.

Finished cases are kept in OUT, so that an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

from tests.own_cases.judge import judge, table
from tests.own_cases.plan import Planned, plan
from tests.rig.cases import make_case
from workbench.diagnosis.diagnose import diagnose
from workbench.plants.arm import arm
from workbench.recordings import read_case


def run(case: Planned, out: Path) -> dict[str, object]:
    """Diagnose one case; returns what is stored of it."""
    kept = out / f"{case.name}.json"
    if kept.exists():
        return dict(json.loads(kept.read_text()))
    with tempfile.TemporaryDirectory() as folder:
        made = read_case(make_case(case.seed, list(case.effects), case.load, Path(folder)))
        began = time.perf_counter()
        found = diagnose(
            arm(made.load_kg), list(made.fit.values()), list(made.hold_out.values())
        ).verdict
    assert found is not None
    data = found.as_data()
    row = judge(case.effects, data) | {
        "effects": case.effects,
        "found": [f["effect"] for f in data["findings"]],
        "fit": data["fit"],
        "seconds": time.perf_counter() - began,
        "sentence": data["sentence"],
    }
    kept.write_text(json.dumps(row, indent=1))
    return row


def main(out: Path, count: int) -> None:
    """Run the first ``count`` cases of the plan."""
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    for case in plan()[:count]:
        row = run(case, out)
        rows.append(row)
        sys.stdout.write(
            f"{case.name} {'+'.join(case.effects) or 'nothing':<34} -> {row['kind']:<16}"
            f" {', '.join(map(str, row['found'])) or '-'}  ({row['seconds']:.0f} s)\n"
        )
        sys.stdout.flush()
    sys.stdout.write(table(rows) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1000)
