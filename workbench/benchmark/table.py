"""The tables of the comparison: nominal and worst, with a mark on every figure that has a goal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from workbench.benchmark.cases import CHANGES
from workbench.benchmark.evidence import EVIDENCE_FAMILY, is_evidence
from workbench.benchmark.figures_of_run import SIZES_DEG, worst_of_all
from workbench.benchmark.goals import GOALS, goals_of, is_missed
from workbench.benchmark.run import FAST, LATE, Comparison
from workbench.reports.tables import Cell, Mark, Table, number
from workbench.verification.responses import Value

NOT_RUN = Value(math.nan, "only steps were run")
"""Value of a scenario that was not run."""

STEP_HEADINGS = (
    "load",
    "family",
    "settling 5° s",
    "settling 15° s",
    "settling 30° s",
    "5° / limit",
    "15° / limit",
    "30° / limit",
    "overshoot %",
    "steady error °",
    "swing °",
)
COURSE_HEADINGS = (
    "load",
    "family",
    "rmse 0.2 Hz °",
    "rmse 0.5 Hz °",
    "rmse 1 Hz °",
    "chatter V/s",
    "air g",
    "mean bar",
    "fallbacks",
)


def ratio_to_limit(
    comparison: Comparison, case: str, figures: Mapping[str, Value], size: int
) -> Value:
    """Return settling time over the physical limit of the same step.

    Args:
        comparison: What was found.
        case: Name of the case.
        figures: Figures of the run, in the units of their names.
        size: Size of the step, in °.

    Returns:
        The ratio (dimensionless), or NaN and the reason.

    Example:
        >>> ratio_to_limit(Comparison({}, {}, {}, {}, 0), "3 kg", {}, 15).reason
        'the physical limit was not computed'
    """
    limit = comparison.limits.get((case, size))
    if limit is None:
        return Value(math.nan, "the physical limit was not computed")
    if math.isnan(limit.value):
        return limit
    settled = figures.get(f"settling_limited_{size}_s", Value(math.nan, "not among the steps"))
    return Value(settled.value / limit.value, settled.reason)


def figures_of(
    comparison: Comparison, family: str, case: str, *, nominal: bool
) -> dict[str, Value]:
    """Return the figures of a family for a load, nominal or the worst of all variations.

    Args:
        comparison: What was found.
        family: Name of the family.
        case: Name of the case.
        nominal: Whether only the nominal variation counts.

    Returns:
        Figures by name, in the units of their names; ``ratio_15`` is the settling time of a step
        of 15° over the physical limit of the same step.

    Example:
        >>> figures_of.__name__
        'figures_of'
    """
    wanted = [
        v
        for v in comparison.variations
        if (family, case, v) in comparison.figures and (v == "nominal" or not nominal)
    ]
    every = []
    for variation in wanted:
        own = dict(comparison.figures[family, case, variation])
        for size in SIZES_DEG:
            if variation != "nominal" and f"settling_limited_{size}_s" not in own:
                continue
            own[f"ratio_{size}"] = ratio_to_limit(comparison, case, own, size)
        every.append(own)
    return worst_of_all(list(every))


def reached_table(comparison: Comparison) -> Table:
    """Build the table of how many goals every family reaches in all variations.

    Args:
        comparison: What was found.

    Returns:
        Goals reached of all that were judged (a count), for each family and load.

    Example:
        >>> reached_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for family in comparison.families:
        cells = []
        for case in comparison.cases:
            if (family, case, "nominal") not in comparison.figures:
                cells.append(Cell("–", reason="not run"))
                continue
            found = figures_of(comparison, family, case, nominal=False)
            judged = [(found[name], goal) for name, goal in goals_of(case).items() if name in found]
            missed = sum(is_missed(figure, goal) for figure, goal in judged)
            text = f"{len(judged) - missed} of {len(judged)}"
            cells.append(Cell(text, "missed" if missed else "met"))
        rows.append((family, *cells))
    return Table("Goals reached in all variations", ("family", *comparison.cases), tuple(rows))


def comparison_table(comparison: Comparison, *, nominal: bool) -> Table:
    """Build the table of steps of all loads and families.

    Args:
        comparison: What was found.
        nominal: Whether the nominal figures or the worst of all variations are shown.

    Returns:
        The table, with marks where there is a goal.

    Example:
        >>> comparison_table(Comparison({}, {}, {}, {}, 0), nominal=True).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for case in comparison.cases:
        for family in comparison.families:
            found = figures_of(comparison, family, case, nominal=nominal)
            goal = goals_of(case)["settling_15_s"]
            rows.append(
                (
                    case,
                    family,
                    _cell(found["settling_5_s"]),
                    _cell(found["settling_15_s"], goal),
                    _cell(found["settling_30_s"]),
                    *(_cell(found[f"ratio_{s}"], GOALS[f"ratio_{s}"]) for s in SIZES_DEG),
                    *(
                        _cell(found[name], GOALS[name])
                        for name in ("overshoot_percent", "steady_deg", "swing_deg")
                    ),
                )
            )
    return Table(
        f"Steps with muscle hysteresis, {_which(nominal)}",
        STEP_HEADINGS,
        tuple(rows),
        "Goals: settling after 15° at most 0.5 s (0.9 s with 8 kg) and twice the physical limit,"
        " overshoot 5 %, steady error and swing 0.05°.",
    )


def courses_table(comparison: Comparison, *, nominal: bool) -> Table:
    """Build the table of sines, effort and mean pressure of all loads and families.

    Args:
        comparison: What was found.
        nominal: Whether the nominal figures or the worst of all variations are shown.

    Returns:
        The table, with marks where there is a goal.

    Example:
        >>> courses_table(Comparison({}, {}, {}, {}, 0), nominal=True).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for case in comparison.cases:
        for family in comparison.families:
            found = figures_of(comparison, family, case, nominal=nominal)
            low, high = (found[f"mean_pressure_{end}_bar"].value for end in ("lowest", "highest"))
            errors = [
                _cell(found.get(f"rmse_{f}_Hz_deg", NOT_RUN), GOALS[f"rmse_{f}_Hz_deg"])
                for f in ("0.2", "0.5", "1")
            ]
            rows.append(
                (
                    case,
                    family,
                    *errors,
                    _cell(found["chatter_V_per_s"]),
                    _cell(found["air_g"]),
                    f"{low:.2f}–{high:.2f}",
                    _cell(found["fallbacks"], GOALS["fallbacks"]) if "fallbacks" in found else "",
                )
            )
    return Table(
        f"Sines of 15°, effort and mean pressure, {_which(nominal)}",
        COURSE_HEADINGS,
        tuple(rows),
        "Goals: rmse 0.3, 0.6 and 1.5°, no fallback. Chatter, air and mean pressure are those of"
        " the steps.",
    )


def _which(nominal: bool) -> str:
    return "nominal" if nominal else "worst of all variations"


def changes_table(comparison: Comparison) -> Table:
    """Build the table of what changes of the plant do to an arm at rest.

    Args:
        comparison: What was found.

    Returns:
        Largest and remaining error after each change, in °.

    Example:
        >>> len(changes_table(Comparison({}, {}, {}, {}, 0)).headings)
        8
    """
    rows: list[tuple[Cell | str, ...]] = []
    for case in comparison.cases:
        for family in comparison.families:
            if (family, case, CHANGES) not in comparison.figures:
                continue
            found = comparison.figures[family, case, CHANGES]
            cells = [
                _cell(found[f"{kind}_after_{name}_deg"], GOALS["steady_deg"] if left else math.inf)
                for name in ("load", "supply", "valve")
                for kind, left in (("peak", False), ("left", True))
            ]
            rows.append((case, family, *cells))
    return Table(
        "Changes while the arm holds 30°",
        ("load", "family", "1 kg: peak °", "1 kg: left °", "5 bar: peak °", "5 bar: left °",
         "0.15 V: peak °", "0.15 V: left °"),
        tuple(rows),
        "The load changes at 0.5 s, the supply at 2 s, the valve's centre at 3.5 s; peak, and what"
        " is left 1.1 to 1.5 s later.",
    )  # fmt: skip


def margins_table(comparison: Comparison) -> Table:
    """Build the table of margins: from the linear models, and one sample of delay on the plant.

    Args:
        comparison: What was found.

    Returns:
        Speed in rad/s, Ms, Mt, and swing and overshoot with a command one sample late.

    Example:
        >>> margins_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for case in comparison.cases:
        for family in comparison.families:
            none = (math.nan, math.nan, math.nan, math.nan)
            speed, ms, mt, slow = comparison.margins.get((family, case), none)
            late = comparison.figures.get((family, case, LATE), {})
            swing = late.get("swing_deg", Value(math.nan, "not run"))
            over = late.get("overshoot_percent", Value(math.nan, "not run"))
            rows.append(
                (
                    case,
                    family,
                    number(speed),
                    number(ms),
                    number(mt),
                    number(slow),
                    _cell(over),
                    _cell(swing, GOALS["swing_deg"]),
                )
            )
    return Table(
        "Margins",
        (
            "load",
            "family",
            "speed rad/s",
            "Ms",
            "Mt",
            "late: Ms",
            "overshoot %",
            "swing °",
        ),
        tuple(rows),
        "Ms and Mt are the largest over two angles, at the known load and at the changed one. Late:"
        " the staircase with every command one sample, 2 ms, late, as from a slow computer.",
    )


def _cell(figure: Value, goal: float = math.inf) -> Cell:
    mark: Mark = ""
    if math.isfinite(goal):
        mark = "missed" if not figure.value <= goal else "met"
        if math.isnan(figure.value) and ("limit" in figure.reason or figure == NOT_RUN):
            mark = "open"
    return Cell(number(figure.value), mark, figure.reason)


def results(comparison: Comparison) -> dict[str, Any]:
    """Return everything as nested mappings of numbers, for a JSON file.

    Args:
        comparison: What was found.

    Returns:
        Numbers with units in their names; reasons where there is no number.

    Example:
        >>> results(Comparison({}, {}, {}, {}, 3))["seed"]
        3
    """
    runs: dict[str, Any] = {}
    for (family, case, variation), found in comparison.figures.items():
        own = {name: figure.value for name, figure in found.items()}
        reasons = {name: figure.reason for name, figure in found.items() if figure.reason}
        if reasons:
            own["reasons"] = reasons  # type: ignore[assignment]
        runs.setdefault(case, {}).setdefault(family, {})[variation] = own
    limits: dict[str, Any] = {}
    for (case, size), limit in sorted(comparison.limits.items()):
        limits.setdefault(case, {})[f"step_{size}_deg_s"] = limit.value
        if limit.reason:
            limits[case][f"step_{size}_deg_reason"] = limit.reason
    summary: dict[str, Any] = {}
    for case in comparison.cases:
        for family in comparison.families:
            summary.setdefault(case, {})[family] = {
                which: {
                    name: figure.value
                    for name, figure in figures_of(
                        comparison, family, case, nominal=which == "nominal"
                    ).items()
                }
                for which in ("nominal", "worst")
            }
    margins = {
        f"{family}, {case}": {"speed_rad_per_s": w, "Ms": ms, "Mt": mt, "Ms_one_sample_late": late}
        for (family, case), (w, ms, mt, late) in comparison.margins.items()
    }
    return {
        "seed": comparison.seed,
        "seeds": comparison.seeds,
        "summary": summary,
        "physical_limits": limits,
        "margins": margins,
        "runs": runs,
    }


def fast_table(comparison: Comparison) -> Table:
    """Build the table of what tolerance of an unknown load costs the empty arm.

    Args:
        comparison: What was found.

    Returns:
        Settling and overshoot of the tolerant and of the fast design, known load and 1 kg more.

    Example:
        >>> fast_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for (family, case, variation), found in comparison.figures.items():
        same = (FAST, case, variation) in comparison.figures
        if family not in (FAST, EVIDENCE_FAMILY) or not same or is_evidence(variation):
            continue
        ratio = ratio_to_limit(comparison, case, found, 15)
        rows.append(
            (
                "for exactly the known load" if family == FAST else "tolerates 1 kg more",
                "as known" if variation == "nominal" else "1 kg more",
                _cell(found["settling_15_s"]),
                _cell(ratio),
                _cell(found["overshoot_percent"]),
                _cell(found["swing_deg"]),
            )
        )
    return Table(
        "The empty arm: speed against tolerance of a load that nobody announced",
        ("state feedback designed", "load", "settling 15° s", "/ limit", "overshoot %", "swing °"),
        tuple(rows),
    )
