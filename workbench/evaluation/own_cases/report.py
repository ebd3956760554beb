"""Tables, figure and summary of kept answers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.display import aligned_table
from workbench.evaluation.own_cases.plan import FACTORS
from workbench.evaluation.own_cases.statistics import (
    ANSWERERS,
    BARS,
    KINDS,
    ByEffect,
    Score,
    by_effect,
    by_size,
    grouped,
    judge,
    right_of,
    score_of,
    scores,
    truths_of,
)
from workbench.evaluation.rates import Rate, reliability_lines, told
from workbench.files import picked

COLOURS = {
    "right": "#1b7837",
    "right class": "#7fbf7b",
    "right group only": "#92c5de",
    "right side only": "#d1e5f0",
    "abstained": "#e0e0e0",
    "wrong name": "#b2182b",
}
"""Colour of an outcome; the worst one of a case counts."""


def tables(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return all tables as text."""
    tool, scored = score_of("tool", rows), scores(rows)
    parts = [
        f"{len(rows)} cases, versions {', '.join(sorted({r['version'] for r in rows}))}",
        _bars(tool),
        _answerers(scored),
        _kinds(rows),
        _sizes(rows),
        _effects(by_effect(rows)),
    ]
    weighed = [
        pair
        for row in rows
        for pair in told(row["verdict"], [name for t in truths_of(row) for name in t.library])
    ]
    parts += ["\n".join(lines)] if (lines := reliability_lines(weighed)) else []
    failed = [
        f"  {row['case']} {row['title']}: {failure}"
        for row in rows
        if (failure := row["verdict"].get("failure"))
    ]
    parts += ["\n".join(["diagnoses that failed", *failed])] if failed else []
    return "\n\n".join(parts)


def _met(name: str, rate: Rate) -> bool:
    sense, bar = BARS[name]
    if not rate.total:
        return False
    return rate.value <= bar if sense == "at most" else rate.value >= bar


def _bars(tool: Score) -> str:
    rates = tool.rates()
    met = {name: "met" if _met(name, rates[name]) else "missed" for name in BARS}
    rows = [
        (name, rates[name], f"{sense} {100 * bar:.0f} %", met[name])
        for name, (sense, bar) in BARS.items()
    ]
    return aligned_table(("bars", "reached", "wanted", ""), rows, width=None)


def _answerers(scored: Sequence[Score]) -> str:
    rates, rounds = [s.rates() for s in scored], [s.round for s in scored]
    rows = [
        ("cases", *(len(s.judged) for s in scored)),
        ("points", *(f"{r.points} of {r.most}" for r in rounds)),
        ("points by random answers", *(f"{r.chance:.0f}, p {r.p_value:.2g}" for r in rounds)),
        *((name, *(r[name] for r in rates)) for name in rates[0]),
        ("held-out error over the limit", *(_three(s.ratio) for s in scored)),
        ("size error, median", *(_percent(s.sizes.median) for s in scored)),
        ("size error, 90 %", *(_percent(s.sizes.worst) for s in scored)),
        ("processor seconds, median", *(_three(s.seconds) for s in scored)),
    ]
    return aligned_table(("", *(s.who for s in scored)), rows, width=None)


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %" if math.isfinite(value) else "-"


def _three(value: float | None) -> str:
    return f"{value:.3g}" if value is not None and math.isfinite(value) else "-"


_RATES = ("right group", "right name or class", "wrong name")


def _kinds(rows: Sequence[Mapping[str, Any]]) -> str:
    told = []
    for kind, own in grouped(rows, "kind", KINDS).items():
        points, most = (sum(getattr(j.line, of) for j in own) for of in ("points", "most"))
        told.append((kind, len(own), f"{points} of {most}", *right_of(own).values()))
    return aligned_table(("kind", "cases", "points", *_RATES), told, width=None)


def _sizes(rows: Sequence[Mapping[str, Any]]) -> str:
    told = [(f"x {f:g}", *rates.values()) for f, rates in by_size(rows).items()]
    return aligned_table(("size", *_RATES), told, width=None)


def _effects(effects: Sequence[ByEffect]) -> str:
    factors = sorted(FACTORS)
    rows = [
        (
            e.effect,
            *(e.outcomes.get(f, "") for f in factors),
            _three(e.smallest_named),
            _three(e.predicted),
            _percent(e.sizes.median),
            f"{e.sizes.coverage.count}/{e.sizes.coverage.total}" if e.sizes.coverage.total else "-",
        )
        for e in effects
    ]
    sizes = (f"x {f:g}" for f in factors)
    head = ("effect", *sizes, "smallest named", "predicted", "size error", "covered")
    return aligned_table(head, rows, width=None)


def cases(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return one line per case."""
    told = []
    for row, j in ((row, judge(row)) for row in rows):
        points = f"{j.line.points} of {j.line.most}"
        remark = f"{j.line.remark} ({_three(j.over_limit)} of the limit, {j.seconds:.0f} s)"
        told.append((row["case"], row["title"], j.line.said, points, remark))
    return aligned_table(("case", "hidden", "said", "points", ""), told, width=None)


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the numbers of the tables as plain data."""
    scored, bars = scores(rows), score_of("tool", rows).rates()
    return {
        "schema": "own_cases/1",
        "cases": len(rows),
        "versions": sorted({r["version"] for r in rows}),
        "bars": {
            name: bars[name].as_data()
            | {"wanted": f"{sense} {bar:g}", "met": _met(name, bars[name])}
            for name, (sense, bar) in BARS.items()
        },
        "answerers": {
            s.who: {
                "cases": len(s.judged),
                "rates": {name: rate.as_data() for name, rate in s.rates().items()},
                "interval_coverage": s.sizes.coverage.as_data(),
                **picked(s.round, "points most points_by_chance=chance p_value"),
                **picked(s.sizes, "median_size_error=median size_error_90=worst"),
                "median_held_out_error_over_limit": s.ratio,
                "median_processor_seconds": s.seconds,
            }
            for s in scored
        },
        "sizes": {
            f"{factor:g}": {name: rate.as_data() for name, rate in rates.items()}
            for factor, rates in by_size(rows).items()
        },
        "effects": [
            {
                "effect": e.effect,
                "outcomes": {f"{f:g}": text for f, text in e.outcomes.items()},
                "smallest_named": e.smallest_named,
                "smallest_predicted": e.predicted,
                "median_size_error": e.sizes.median,
                "interval_coverage": e.sizes.coverage.as_data(),
            }
            for e in by_effect(rows)
        ],
        "each": [judge(row).line.as_data() | {"hidden": row["title"]} for row in rows],
    }


def figure(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw detection by size, and the tool beside the baselines."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.patches import Rectangle

    effects, scored = by_effect(rows), scores(rows)
    factors = sorted({f for effect in effects for f in effect.outcomes})
    plot, axes = plt.subplot_mosaic(
        [["size", "points"], ["size", "rates"]],
        figsize=(11.0, 1.5 + 0.2 * max(len(effects), 20)),
        width_ratios=(1.0, 1.15),
        layout="constrained",
    )
    left, top, bottom = axes["size"], axes["points"], axes["rates"]
    for i, effect in enumerate(effects):
        for k, factor in enumerate(factors):
            remark = effect.outcomes.get(factor)
            if remark is not None:
                colour = COLOURS[_worst(remark)]
                left.add_patch(Rectangle((k - 0.46, i - 0.42), 0.92, 0.84, color=colour))
    left.set(
        xlim=(-0.5, max(len(factors), 1) - 0.5),
        ylim=(max(len(effects), 1) - 0.5, -0.5),
        xticks=range(len(factors)),
        xticklabels=[f"x {f:g}" for f in factors],
        yticks=range(len(effects)),
        yticklabels=[e.effect.replace("_", " ") for e in effects],
        title="Single effects by size",
    )
    left.tick_params(length=0, labelsize=8)
    left.spines[:].set_visible(False)
    marks = [Rectangle((0, 0), 1, 1, color=c) for c in COLOURS.values()]
    plot.legend(marks, list(COLOURS), loc="outside lower left", ncols=6, fontsize=8, frameon=False)

    names = [s.who for s in scored]
    top.bar(
        names,
        [100 * s.round.points / s.round.most if s.round.most else 0.0 for s in scored],
        color=[ANSWERERS[n] for n in names],
    )
    top.axhline(0.0, color="black", lw=0.8)
    top.set(ylabel="points, % of most", title="Points by the rules of a blind round")
    shown = ("right group", "right name or class", "confidently wrong", "false alarms")
    step = 0.8 / len(scored)
    for j, score in enumerate(scored):
        rates = [score.rates()[name] for name in shown]
        values = np.array([100 * r.value if r.total else 0.0 for r in rates])
        low, high = 100 * np.array([r.interval for r in rates]).T
        spans = np.maximum(0.0, [values - low, high - values])
        bottom.bar(
            np.arange(len(shown)) - 0.4 + (j + 0.5) * step,
            values,
            width=step,
            yerr=spans,
            label=score.who,
            error_kw={"lw": 0.8},
            color=ANSWERERS[score.who],
        )
    bottom.set_xticks(range(len(shown)), [n.replace(" or ", "\nor ") for n in shown], fontsize=8)
    bottom.set(ylabel="%", ylim=(0, 112), title="Rates with 95 % intervals")
    bottom.legend(fontsize=8, frameon=False, loc="upper center", ncols=4)
    plot.savefig(path, dpi=150)
    plt.close(plot)


def _worst(remark: str) -> str:
    return max(remark.split(", "), key=list(COLOURS).index)
