"""Judging a verdict against what was hidden."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from tests.own_cases.plan import ANSWERS


def judge(effects: Sequence[str], verdict: Mapping[str, Any]) -> dict[str, Any]:
    """Say for a verdict whether places and names are right.

    Args:
        effects: What is hidden, by the rig's names.
        verdict: Content of a ``verdict.json``.

    Returns:
        Counts: hidden, located, named, wrong names, names where nothing is hidden.
    """
    findings = verdict["findings"]
    open_effects = list(effects)
    named = located = wrong = 0
    for finding in findings:
        places = {port.split(".")[0] for port in finding["where"]}
        names = {finding["effect"], *finding["class"]}
        right = next((e for e in open_effects if names & set(ANSWERS[e][0])), None)
        near = next((e for e in open_effects if _near(places, ANSWERS[e][1])), None)
        if right is not None:
            open_effects.remove(right)
            named, located = named + 1, located + 1
        else:
            wrong += 1
            located += near is not None
    return {
        "hidden": len(effects),
        "located": located,
        "named": named,
        "wrong": wrong,
        "silent": not findings,
        "kind": verdict["verdict"],
    }


def _near(places: set[str], components: Sequence[str]) -> bool:
    # Joint and muscle forces are one group: angle and pressures cannot tell them apart.
    force = any(p == "joint" or p.startswith("muscle") for p in places)
    return any(
        p.startswith(c) or (force and c in ("joint", "muscle")) for p in places for c in components
    )


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rates over judged cases.

    Args:
        rows: What `judge` returned for each case.

    Returns:
        A short table.
    """
    clean = [r for r in rows if r["hidden"] == 0]
    faulty = [r for r in rows if r["hidden"] > 0]
    hidden = sum(r["hidden"] for r in faulty)
    lines = [
        f"cases with nothing hidden      {len(clean)}",
        f"  a name all the same          {sum(not r['silent'] for r in clean)}",
        f"hidden effects                 {hidden}",
        f"  right group                  {sum(r['located'] for r in faulty)}",
        f"  right name or class          {sum(r['named'] for r in faulty)}",
        f"  confidently wrong names      {sum(r['wrong'] for r in faulty)}",
        f"verdicts                       {dict(Counter(r['kind'] for r in rows))}",
    ]
    return "\n".join(lines)
