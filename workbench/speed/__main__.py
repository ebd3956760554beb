"""Run the benchmarks and print their table."""

from __future__ import annotations

import sys

from workbench.speed.timings import run_benchmarks

if __name__ == "__main__":
    sys.stdout.write(f"{run_benchmarks(progress=lambda text: None)}\n")
