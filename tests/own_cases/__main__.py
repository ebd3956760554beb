"""Make cases, diagnose them and keep the answers.

``python -m tests.own_cases OUT [COUNT] [--seeds FIRST] [--part K/N] [--no-baselines]``

Finished cases are kept in OUT, one JSON file each, so that an interrupted run goes on where it
stopped and several processes share the work, each with its part of the plan. The tables come from
``python -m tests.own_cases.report OUT``.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

# One process per part: threads of linear algebra would only get in each other's way.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from tests.own_cases.plan import FIRST_SEED, plan  # noqa: E402
from tests.own_cases.run import run  # noqa: E402


def part_of(text: str) -> tuple[int, int]:
    """Read ``K/N``: part K of N, counted from 1."""
    first, _, second = text.partition("/")
    k, n = int(first), int(second)
    if not 1 <= k <= n:
        raise argparse.ArgumentTypeError(f"part {text} must be 1/N to N/N")
    return k, n


def main(words: list[str] | None = None) -> None:
    """Run a part of the plan."""
    parser = argparse.ArgumentParser(prog="python -m tests.own_cases", description=__doc__)
    parser.add_argument("out", type=Path, help="folder of the answers")
    parser.add_argument("count", type=int, nargs="?", default=110, help="cases of the plan")
    parser.add_argument("--seeds", type=int, default=FIRST_SEED, help="seed of the first case")
    parser.add_argument("--part", type=part_of, default=(1, 1), help="part K of N: every Nth case")
    parser.add_argument("--only", nargs="*", default=(), help="names of cases, such as own-2003")
    parser.add_argument("--jobs", type=int, default=1, help="processes of one diagnosis")
    parser.add_argument("--no-baselines", action="store_true", help="leave the baselines out")
    given = parser.parse_args(words)
    given.out.mkdir(parents=True, exist_ok=True)
    k, n = given.part
    cases = plan(given.seeds)
    chosen = [c for c in cases if c.name in given.only] if given.only else cases[: given.count]
    for case in chosen[k - 1 :: n]:
        row = run(case, given.out, baselines=not given.no_baselines, jobs=given.jobs)
        found = [f["effect"] or "?" for f in row["verdict"]["findings"]]
        sys.stdout.write(
            f"{case.name} {case.title:<38} -> {row['verdict']['verdict']:<16}"
            f" {', '.join(found) or '-'}  ({row['seconds']:.0f} s)\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
