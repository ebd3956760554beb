"""What keeps a figure from its goal: each miss with its obstacle, each obstacle with its runs."""

from __future__ import annotations

import math
from collections.abc import Mapping

from workbench.benchmark.evidence import (
    DRY,
    EVIDENCE_FAMILY,
    EXACT,
    PACED_VARIATIONS,
    PACES,
    SWIFT,
    paced_name,
)
from workbench.benchmark.figures_of_run import SIZES_DEG
from workbench.benchmark.run import FAST, Comparison
from workbench.benchmark.table import figures_of
from workbench.reports.tables import Cell, Mark, Table, number
from workbench.verification.responses import Value

KILOGRAM = "A. The unknown kilogram"
"""Obstacle: a load that the design must bear without knowing of it."""

HYSTERESIS = "B. Muscle hysteresis"
"""Obstacle: a force that no design knows."""

DELAY = "C. Spool, sample and margins"
"""Obstacle: what a loop of finite bandwidth adds to the plan."""

DESIGN = "D. The design, not physics"
"""Obstacle: another family reaches the goal on the same plants."""

ROWS = (
    ("nominal", "everything"),
    (DRY, "no muscle hysteresis"),
    (EXACT, "no noise and converters"),
    (SWIFT, "a spool ten times as fast"),
)
"""Variations, and what the plant still has or has no more."""

TITLES = {EVIDENCE_FAMILY: EVIDENCE_FAMILY, FAST: "state feedback for exactly the known load"}
"""Designs that are run without obstacles."""

GOAL = 2.0
"""Settling over the limit that is wanted, a ratio."""

OVERSHOOT = 5.0
"""Overshoot that is wanted, %."""

STEPS = ("35° to 30°", "20° to 35°", "5° to 35°")
"""Steps that are compared with the limit, one of each of `SIZES_DEG`."""

Figures = Mapping[str, Value]


def obstacles_table(comparison: Comparison) -> Table:
    """Build the table of settling with one obstacle less at a time.

    Args:
        comparison: What was found.

    Returns:
        Settling of the limited steps in s and over the limit, for each load and design.

    Example:
        >>> obstacles_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for family, title in TITLES.items():
        for case in comparison.cases:
            for variation, what in ROWS:
                own = comparison.figures.get((family, case, variation))
                if own is not None and (family, case, DRY) in comparison.figures:
                    cells = [_settled(comparison, case, own, size) for size in SIZES_DEG]
                    rows.append((case, title, what, *cells))
    return Table(
        "One obstacle less at a time: settling in s, and over the limit",
        ("load", "design", "the plant has", *STEPS),
        tuple(rows),
        "Each row has what the row above has, less what it names. What is left in the last row is"
        " the smooth plan, the sample time and the margins of the loop.",
    )


def _settled(comparison: Comparison, case: str, figures: Figures, size: int) -> Cell:
    settled = figures[f"settling_limited_{size}_s"]
    ratio = settled.value / _limit(comparison, case, size)
    if math.isnan(ratio):
        return Cell(number(settled.value), reason=settled.reason)
    return Cell(f"{number(settled.value)} ({number(ratio)})", "met" if ratio <= GOAL else "missed")


def _limit(comparison: Comparison, case: str, size: int) -> float:
    return comparison.limits.get((case, size), Value(math.nan)).value


def plan_table(comparison: Comparison) -> Table:
    """Build the table of the evidence family with faster and slower plans.

    Args:
        comparison: What was found.

    Returns:
        Settling over the limit at the known load; overshoot (%) and swing (°), the worst of what
        the plan is not made for.

    Example:
        >>> plan_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for case in comparison.cases:
        for pace in sorted((*PACES, 1.0)):
            found = _paced(comparison, case, pace)
            if not found:
                continue
            own = found["nominal"]
            ratios = [
                own[f"settling_limited_{s}_s"].value / _limit(comparison, case, s)
                for s in SIZES_DEG
            ]
            overshoots = [_worst(found, f"overshoot_{s}_percent") for s in SIZES_DEG]
            swing = _worst(found, "swing_deg")
            rows.append(
                (
                    case,
                    f"× {pace:g}",
                    *(Cell(number(r), _mark(r, GOAL)) for r in ratios),
                    *(Cell(number(o), _mark(o, OVERSHOOT)) for o in overshoots),
                    Cell(number(swing), _mark(swing, 0.05)),
                )
            )
    return Table(
        f"{KILOGRAM}: {EVIDENCE_FAMILY} with its planned moves made shorter and longer",
        (
            "load",
            "duration of the plan",
            "as known: 5° / limit",
            "15° / limit",
            "30° / limit",
            "worst: overshoot 5°, %",
            "overshoot 15°, %",
            "overshoot 30°, %",
            "swing °",
        ),
        tuple(rows),
        f"Worst of {', '.join(PACED_VARIATIONS)}. The feedback is the same in all rows of a load.",
    )


def _mark(value: float, goal: float) -> Mark:
    if math.isnan(value):
        return "open"
    return "met" if value <= goal else "missed"


def _paced(comparison: Comparison, case: str, pace: float) -> dict[str, Figures]:
    """Return the runs of the evidence family with a plan, by variation."""
    if (EVIDENCE_FAMILY, case, paced_name("nominal", PACES[0])) not in comparison.figures:
        return {}
    keys = {v: (EVIDENCE_FAMILY, case, paced_name(v, pace)) for v in PACED_VARIATIONS}
    return {v: comparison.figures[key] for v, key in keys.items() if key in comparison.figures}


def _worst(found: Mapping[str, Figures], name: str) -> float:
    values = [own[name].value for own in found.values() if name in own]
    return math.nan if any(math.isnan(v) for v in values) else max(values, default=math.nan)


def plan_words(comparison: Comparison) -> list[str]:
    """Say what a faster plan costs, for each load whose plan is longer than wanted.

    Args:
        comparison: What was found.

    Returns:
        A sentence for each load.

    Example:
        >>> plan_words(Comparison({}, {}, {}, {}, 0))
        []
    """
    found = []
    for case in comparison.cases:
        rows = {pace: _paced(comparison, case, pace) for pace in sorted((*PACES, 1.0))}
        if not any(rows.values()):
            continue
        ratios = {
            pace: max(
                own["nominal"][f"settling_limited_{s}_s"].value / _limit(comparison, case, s)
                for s in SIZES_DEG
            )
            for pace, own in rows.items()
        }
        overshoots = {pace: _worst(own, "overshoot_percent") for pace, own in rows.items()}
        bearable = [pace for pace in rows if overshoots[pace] <= OVERSHOOT]
        wanted = [pace for pace in rows if ratios[pace] <= GOAL]
        if not ratios[1.0] > GOAL:
            continue
        text = f"{case}: " + (
            f"the shortest plan that stays within {OVERSHOOT:g} % with what it does not know is"
            f" × {bearable[0]:g}, with {number(ratios[bearable[0]])} times the limit as the largest"
            " of the three steps"
            if bearable
            else f"no plan that was tried stays within {OVERSHOOT:g} %"
        )
        fastest = wanted[-1] if wanted else min(rows)
        what = (
            f"twice the limit is reached with × {fastest:g}"
            if wanted
            else f"even × {fastest:g} does not reach twice the limit"
            f" ({number(ratios[fastest])} times)"
        )
        over = overshoots[fastest]
        ends = "does not settle" if math.isnan(over) else f"overshoots by {number(over)} %"
        found.append(f"{text}; {what}, and there it {ends} with 1 kg more or 5 bar.")
    return found


def reason_of_miss(comparison: Comparison, case: str, family: str, name: str, goal: float) -> str:
    """Say in a sentence what keeps a figure from its goal, from the runs.

    Args:
        comparison: What was found.
        case: Name of the case.
        family: Name of the family.
        name: Name of the figure, with its unit at its end, or ``ratio_15``.
        goal: The goal, in the unit of the figure.

    Returns:
        The obstacle by its name, and the numbers that show it.

    Example:
        >>> reason_of_miss(Comparison({}, {}, {}, {}, 0), "3 kg", "PID", "steady_deg", 0.05)
        ''
    """
    runs = {
        v: comparison.figures[family, case, v]
        for v in comparison.variations
        if (family, case, v) in comparison.figures
    }
    if not runs:
        return ""
    better = _rival(comparison, case, family, name, goal)
    if better:
        own_worst = figures_of(comparison, family, case, nominal=False)[name].value
        return f"{DESIGN}: {better}; this one {number(own_worst)}."
    if name.startswith("ratio_"):
        return _reason_of_ratio(comparison, case, family, int(name.removeprefix("ratio_")), runs)
    values = {v: own[name].value for v, own in runs.items() if name in own}
    bad = [v for v, value in values.items() if not value <= goal]
    share = f"{number(values['nominal'])} nominal" if "nominal" in values else ""
    listed = ", ".join(f"{number(values[v])} with {v}" for v in bad if v != "nominal")
    both = "; ".join(part for part in (share, listed) if part)
    if bad == ["1 kg"]:
        return f"{KILOGRAM}: {both}."
    if "nominal" in bad:
        dry = comparison.figures.get((family, case, DRY), {}).get(name)
        if dry is not None and dry.value <= goal:
            return f"{HYSTERESIS}: {both}; {number(dry.value)} without it."
    return f"{DELAY}: {both}."


def _rival(comparison: Comparison, case: str, family: str, name: str, goal: float) -> str:
    """Return which other family reaches a goal in all variations, with its figure, or nothing."""
    found = {}
    for other in comparison.families:
        if other != family and (other, case, "nominal") in comparison.figures:
            worst = figures_of(comparison, other, case, nominal=False).get(name)
            if worst is not None and worst.value <= goal:
                found[other] = worst.value
    if not found:
        return ""
    best = min(found, key=lambda other: found[other])
    return f"{best} reaches {number(found[best])} at worst"


def _reason_of_ratio(
    comparison: Comparison, case: str, family: str, size: int, runs: Mapping[str, Figures]
) -> str:
    limit = _limit(comparison, case, size)
    allowed = GOAL * limit
    key = f"settling_limited_{size}_s"
    own = runs["nominal"]
    plan = own.get(f"settling_planned_{size}_s")
    if plan is not None and plan.value > allowed:
        return (
            f"{KILOGRAM}: the plan alone takes {number(plan.value)} s of {number(allowed)} s that"
            " are allowed."
        )
    nominal = own[key].value
    dry = comparison.figures.get((family, case, DRY), {}).get(key)
    planned = "" if plan is None else f"the plan takes {number(plan.value)} s, "
    if not nominal <= allowed:
        if dry is not None and dry.value <= allowed:
            return (
                f"{HYSTERESIS}: {number(nominal)} s of {number(allowed)} s, {number(dry.value)} s"
                " without it."
            )
        bare = f" (without hysteresis {number(dry.value)} s)" if dry is not None else ""
        return (
            f"{DELAY}: {planned}the angle {number(nominal)} s{bare} of {number(allowed)} s that"
            " are allowed."
        )
    late = {v: o[key].value for v, o in runs.items() if key in o and not o[key].value <= allowed}
    words = ", ".join(f"{number(t)} s with {v}" for v, t in late.items())
    name = KILOGRAM if list(late) == ["1 kg"] else DELAY
    return f"{name}: {number(nominal)} s nominal of {number(allowed)} s; {words}."


def obstacle_words(comparison: Comparison) -> list[str]:
    """Say in sentences what every obstacle costs, where a goal of settling is missed.

    Args:
        comparison: What was found.

    Returns:
        A sentence for each load and size of step whose settling misses the goal.

    Example:
        >>> obstacle_words(Comparison({}, {}, {}, {}, 0))
        []
    """
    found = []
    for case in comparison.cases:
        ladder = [
            comparison.figures.get((EVIDENCE_FAMILY, case, variation)) for variation, _ in ROWS
        ]
        if any(own is None for own in ladder):
            continue
        for size in SIZES_DEG:
            limit = _limit(comparison, case, size)
            whole, dry, exact, swift = (
                own[f"settling_limited_{size}_s"].value for own in ladder if own is not None
            )
            if not whole > GOAL * limit:
                continue
            plan = ladder[0][f"settling_planned_{size}_s"].value  # type: ignore[index]
            found.append(
                f"{case}, {size}°: the limit is {number(limit)} s, the plan takes {number(plan)} s"
                f" and the angle {number(whole)} s. Hysteresis that the design does not know"
                f" accounts for {1e3 * (whole - dry):.0f} ms, noise and converters for"
                f" {1e3 * (dry - exact):.0f} ms, the lag of the spool for"
                f" {1e3 * (exact - swift):.0f} ms; the other {1e3 * (swift - limit):.0f} ms lie"
                " between the limit, which knows the plant exactly and opens the valve fully, and"
                " a smooth move followed by a loop with margins."
            )
    return found
