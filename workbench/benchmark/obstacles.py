"""What keeps a step from the physical limit: the same designs with one obstacle less at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping

from workbench.benchmark.figures_of_run import SIZES_DEG
from workbench.benchmark.run import DRY, EVIDENCE_FAMILY, EXACT, FAST, Comparison
from workbench.reports.tables import Cell, Table, number
from workbench.verification.responses import Figure

ROWS = (
    ("nominal", "everything"),
    (DRY, "no muscle hysteresis"),
    (EXACT, "no noise and converters"),
)
"""Variations, and what the plant still has or has no more."""

TITLES = {EVIDENCE_FAMILY: EVIDENCE_FAMILY, FAST: "state feedback for exactly the known load"}
"""Designs that are run without obstacles."""

GOAL = 2.0
"""Settling over the limit that is wanted, a ratio."""


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
            if (family, case, DRY) not in comparison.figures:
                continue
            for variation, what in ROWS:
                own = comparison.figures[family, case, variation]
                cells = [_settled(comparison, case, own, size) for size in SIZES_DEG]
                rows.append((case, title, what, *cells))
    return Table(
        "What keeps a step from the limit: settling in s, and over the limit",
        ("load", "design", "the plant has", "35° to 30°", "20° to 35°", "5° to 35°"),
        tuple(rows),
        "Each row has what the row above has, less what it names. What is left in the last row is"
        " the smooth plan, the spool, the sample time and the margins of the loop.",
    )


def _settled(comparison: Comparison, case: str, figures: Mapping[str, Figure], size: int) -> Cell:
    settled = figures[f"settling_limited_{size}_s"]
    limit = comparison.limits.get((case, size), Figure(math.nan))
    ratio = settled.value / limit.value
    if math.isnan(ratio):
        return Cell(number(settled.value), reason=settled.reason)
    return Cell(f"{number(settled.value)} ({number(ratio)})", "met" if ratio <= GOAL else "missed")


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
            limit = comparison.limits.get((case, size), Figure(math.nan)).value
            whole, dry, exact = (
                own[f"settling_limited_{size}_s"].value for own in ladder if own is not None
            )
            if not whole > GOAL * limit:
                continue
            plan = ladder[0][f"settling_planned_{size}_s"].value  # type: ignore[index]
            found.append(
                f"{case}, {size}°: the limit is {number(limit)} s, the plan takes {number(plan)} s"
                f" and the angle {number(whole)} s. Hysteresis that the design does not know"
                f" accounts for {1e3 * (whole - dry):.0f} ms, noise and converters for"
                f" {1e3 * (dry - exact):.0f} ms; the other {1e3 * (exact - limit):.0f} ms lie"
                " between the limit, which knows the plant exactly and opens the valve fully, and"
                " a smooth move followed through the spool by a loop with margins."
            )
    return found
