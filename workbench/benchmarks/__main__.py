"""Run the benchmarks and print their table."""

from __future__ import annotations

from workbench.benchmarks.suite import run_benchmarks

if __name__ == "__main__":
    print(run_benchmarks(progress=print))
