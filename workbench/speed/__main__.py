"""Run the benchmark, print it, and write its page and its numbers."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.computing import one_thread

if TYPE_CHECKING:
    from workbench.reports.page import Page
    from workbench.speed.benchmark import Benchmark


def _write(found: Benchmark, out: Path) -> Page:
    from workbench.files import json_text, write_whole
    from workbench.reports.page import write_page
    from workbench.speed.page import benchmark_page

    write_whole(out / "benchmark.json", json_text(found.table()))
    page = benchmark_page(found, command="make benchmark")
    write_page(page, out / "benchmark.html")
    return page


def main() -> None:
    """Measure what is asked for."""
    # Threads of linear algebra would compete with what is timed.
    one_thread()
    from workbench.reports.tables import Table
    from workbench.speed.benchmark import PARTS, run_benchmark

    parser = argparse.ArgumentParser(prog="python -m workbench.speed", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/benchmark"))
    parser.add_argument("--only", action="append", choices=list(PARTS), default=[])
    asked = parser.parse_args()

    def say(name: str, found: Benchmark) -> None:
        sys.stderr.write(f"{name} ...\n")
        if found.figures:
            # What is measured is not lost if the rest is interrupted.
            _write(found, asked.out)

    found = run_benchmark(asked.only, progress=say)
    tables = [str(b) for b in _write(found, asked.out).blocks if isinstance(b, Table)]
    sys.stdout.write("\n\n".join(tables) + f"\nopen {asked.out / 'benchmark.html'}\n")


if __name__ == "__main__":
    main()
