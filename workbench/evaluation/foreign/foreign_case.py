"""Diagnose foreign machines and judge the verdicts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from workbench.evaluation.answer_key import Names, Truth
from workbench.evaluation.blind_round import LARGEST_RATIO, Line, answer_of, error_ratio, score_case
from workbench.evaluation.foreign.plan import Case
from workbench.evaluation.kept import diagnosed, version
from workbench.evaluation.rates import Rate, reliability_lines, told
from workbench.recordings.aligned_table import aligned_table

SCHEMA = "foreign_case/1"


def answer(case: Case, jobs: int) -> dict[str, Any]:
    """Diagnose one case; returns what is kept of it."""
    made = case.recordings()
    held_out = [r for name, r in made.items() if name.startswith("hold")]
    row: dict[str, Any] = {
        "schema": SCHEMA,
        "case": case.name,
        "title": case.title,
        "machine": case.machine.name,
        "hidden": [vars(t) for t in case.truths()],
        "true": case.parameters(),
        "limit": case.limit(held_out),
        "version": version(),
    }
    fit_on = [r for name, r in made.items() if name.startswith("fit")]
    return diagnosed(row, case.build(), fit_on, held_out, jobs=jobs)


def judge(row: Mapping[str, Any]) -> Line:
    """Score a kept case by the rules of a blind round."""
    truths = [
        Truth(t["word"], tuple(t["library"]), tuple(t["groups"]), t["sensor"])
        for t in row["hidden"]
    ]
    return score_case(answer_of(row["verdict"], row["case"], Names({}, {})), truths)


def over_limit(row: Mapping[str, Any]) -> float:
    """Return the held-out error over that of the truth, dimensionless; NaN if there is none."""
    held_out = row["verdict"].get("fit", {}).get("held_out", {})
    return error_ratio(held_out.get("extended") or {}, row["limit"])


def refused_right(row: Mapping[str, Any]) -> list[str]:
    """Return right names that gained on held-out recordings and are not in the verdict."""
    right = {name for truth in row["hidden"] for name in truth["library"]}
    said = {name for f in row["verdict"]["findings"] for name in (f["effect"], *f["class"])}
    return [] if right & said else [
        f"{r['effect']} ({r['reason']})"
        for r in row["verdict"].get("refused", ())
        if r["effect"] in right and (r["held_out_gain"][1] or 0.0) > 0.0
    ]  # fmt: skip


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a kept case."""
    line, failure = judge(row), row["verdict"].get("failure", "")
    tail = "; ".join([*refused_right(row), *([failure] if failure else [])])
    outside = " (outside the library)" if any(not t["library"] for t in row["hidden"]) else ""
    return (
        f"{row['case']} {row['title']:<40} {line.said:<44} {line.points:>3} of {line.most:<3}"
        f" {line.remark}{outside}; {over_limit(row):.3g} of the limit, {row['seconds']:.0f} s"
        + (f"; {tail}" if tail else "")
    )


def tables(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return bars, machines and effects as text."""
    rates = rates_of(rows)
    machines = {
        name: rates_of([r for r in rows if r["machine"] == name])
        for name in dict.fromkeys(r["machine"] for r in rows)
    }
    shown = ("false names", "right name or class", "held-out error within 1.5 of the truth")
    lines = [
        f"{len(rows)} cases, versions {', '.join(sorted({r['version'] for r in rows}))}",
        "",
        aligned_table(("", "reached", "wanted"), [(n, rates[n], bar) for n, bar in BARS.items()]),
        "",
        aligned_table(
            ("machine", *shown),
            [(name, *(own[rate] for rate in shown)) for name, own in machines.items()],
        ),
    ]
    weighed = [
        pair
        for row in rows
        for pair in told(row["verdict"], [name for t in row["hidden"] for name in t["library"]])
    ]
    lines += ["", *reliability_lines(weighed)]
    by_effect: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        by_effect[row["title"]].append(judge(row).remark)
    told_of = [(title, "; ".join(said)) for title, said in sorted(by_effect.items())]
    return "\n".join([*lines, "", aligned_table(("hidden", "said"), told_of, width=None)])


BARS = {
    "false names": "0",
    "right name or class": "at least 85 %",
    "right name or class, what the library has": "",
    "right place": "",
    "wrong name": "",
    "held-out error within 1.5 of the truth": "at least 85 %",
    "gains but is refused": "0",
    "diagnosis failed": "0",
}
"""What is counted, and what is wanted."""


def rates_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, Rate]:
    """Return the rates that the bars are about, with their intervals."""
    judged = [(row, judge(row)) for row in rows]
    clean = [(r, j) for r, j in judged if not r["hidden"]]
    faulty = [(r, j) for r, j in judged if r["hidden"]]
    named = [(t, right) for r, j in faulty for t, right in zip(r["hidden"], j.named, strict=True)]
    within = "held-out error within 1.5 of the truth"
    return {
        "false names": Rate.of(_names(r) for r, _ in clean),
        "right name or class": Rate.of(right for _, right in named),
        "right name or class, what the library has": Rate.of(r for t, r in named if t["library"]),
        "right place": Rate.of(right for _, j in faulty for right in j.located),
        "wrong name": Rate.of("wrong name" in j.remark for _, j in faulty),
        within: Rate.of(over_limit(r) <= LARGEST_RATIO for r in rows),
        "gains but is refused": Rate.of(bool(refused_right(r)) for r, _ in faulty),
        "diagnosis failed": Rate.of(r["verdict"]["verdict"] == "failed" for r in rows),
    }


def _names(row: Mapping[str, Any]) -> bool:
    return any(f["effect"] not in (None, "nonparametric") for f in row["verdict"]["findings"])


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the rates and a line per case as plain data."""
    return {
        "schema": "foreign_cases/1",
        "cases": len(rows),
        "versions": sorted({r["version"] for r in rows}),
        "rates": {name: rate.as_data() for name, rate in rates_of(rows).items()},
        "each": [
            judge(row).as_data()
            | {"hidden": row["title"], "over_limit": over_limit(row), "refused": refused_right(row)}
            for row in rows
        ],
    }
