"""The page of the comparison: tables, pictures, what physics prevents and how it was found."""

from __future__ import annotations

import math
from pathlib import Path

from workbench.benchmark.cases import BEGIN, CASES, CHANGES, HOLD, STEPS_DEG
from workbench.benchmark.figures import pressure_drift, tracking_errors
from workbench.benchmark.figures_of_run import SIZES_DEG
from workbench.benchmark.goals import GOALS, goals_of, is_missed
from workbench.benchmark.obstacles import (
    DELAY,
    HYSTERESIS,
    KILOGRAM,
    STEPS,
    obstacle_words,
    obstacles_table,
    plan_table,
    plan_words,
    reason_of_miss,
)
from workbench.benchmark.run import LATE, Comparison, Curves
from workbench.benchmark.table import (
    changes_table,
    comparison_table,
    courses_table,
    fast_table,
    figures_of,
    margins_table,
    reached_table,
    results,
)
from workbench.files import write_whole
from workbench.reports.figures.steps import ClosedLoopCurves, closed_loop_steps
from workbench.reports.page import Commands, Method, Page, Section, Words, write_page
from workbench.reports.pictures import Picture, save
from workbench.reports.results import json_text
from workbench.reports.tables import Cell, Table, number

DRAWN_STEP = 3
"""Index of the step that is drawn: 20° to 35°."""


def comparison_page(comparison: Comparison, *, minutes: float = math.nan) -> Page:
    """Build the page.

    Args:
        comparison: What was found.
        minutes: How long the comparison took, in minutes (60 s).

    Returns:
        The page.

    Example:
        >>> comparison_page.__name__
        'comparison_page'
    """
    sections = (
        Section(
            "figures",
            "What every family reaches",
            (
                Words(
                    "Each controller was designed from linear models of the nominal plant for its "
                    "known load, without muscle hysteresis and without any of the variations, and "
                    "ran unchanged on the full plant at 500 Hz with sensor noise, 12-bit "
                    f"converters and muscle hysteresis of 10 N + 7 N/bar. Variations: "
                    f"{', '.join(v for v in comparison.variations if v != 'nominal')}. Every"
                    f" staircase ran with {_seeds(comparison)} of the sensors' noise; the worst"
                    " counts."
                ),
                reached_table(comparison),
                *(comparison_table(comparison, nominal=nominal) for nominal in (True, False)),
                *(courses_table(comparison, nominal=nominal) for nominal in (True, False)),
                changes_table(comparison),
            ),
        ),
        Section("pictures", "Steps and sines", tuple(_pictures(comparison))),
        Section(
            "physics",
            "What is not reached, and what prevents it",
            (
                missed_table(comparison),
                Words(_kilogram(comparison)),
                plan_table(comparison),
                *(Words(text) for text in plan_words(comparison)),
                limits_table(comparison),
                fast_table(comparison),
                Words(BY_HYSTERESIS),
                obstacles_table(comparison),
                *(Words(text) for text in obstacle_words(comparison)),
                Words(BY_DELAY),
                time_table(comparison),
                *(Words(text) for text in _late(comparison)),
                Words(BY_MEAN),
            ),
        ),
        Section("margins", "How close to the edge", (margins_table(comparison),)),
        Section(
            "method",
            "How it was done",
            (
                Method(METHOD),
                Commands(("workbench controllers --out controllers",)),
            ),
        ),
    )
    facts = [("seed", str(comparison.seed)), ("runs", str(len(comparison.figures)))]
    if math.isfinite(minutes):
        facts.append(("duration", f"{minutes:.1f} min"))
    return Page(
        "Controllers on the full plant",
        f"{_count(comparison.families, 'family', 'families')},"
        f" {_count(comparison.cases, 'load', 'loads')},"
        f" {_count(comparison.variations, 'plant', 'plants')} each: settling, errors, air,"
        " and the distance to what physics allows.",
        sections,
        tuple(facts),
    )


def _count(things: tuple[str, ...], one: str, several: str) -> str:
    return f"{len(things)} {one if len(things) == 1 else several}"


def _seeds(comparison: Comparison) -> str:
    return "one seed" if comparison.seeds == 1 else f"{comparison.seeds} seeds"


METHOD = (
    (
        "design",
        "joint models fitted to linear models at 13 angles and two mean pressures, gains and "
        "feedforward interpolated; the fastest design of each family within limits on Ms and Mt "
        "at the known and at the changed load",
    ),
    (
        "steps",
        f"a staircase over {', '.join(f'{a:g}' for a in STEPS_DEG)}°, {HOLD:g} s each; per size "
        "the worst step counts",
    ),
    (
        "settling",
        "time from the step of the reference until the angle stays within 2 % of the step",
    ),
    (
        "settling / limit",
        "settling time over the time-optimal entry into the same band of the plant without "
        "hysteresis, same step",
    ),
    (
        "steady error, swing",
        "mean, and half of highest minus lowest, in the last 0.5 s of each step",
    ),
    (
        "rmse",
        "of reference minus angle after half a period; a sine starts at full speed, which no arm "
        "at rest can follow. The figure over the whole run is in results.json as rmse_from_rest",
    ),
    ("chatter, air", "total variation of the voltage per second; air drawn during the staircase"),
    ("mean bar", "lowest and highest mean of the two pressures during the staircase"),
)


def limits_table(comparison: Comparison) -> Table:
    """Build the table of physical limits.

    Args:
        comparison: What was found.

    Returns:
        Time-optimal moves per load and size of step, in s.

    Example:
        >>> limits_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    heavier = sorted({case for case, _ in comparison.limits} - set(comparison.cases))
    for case in (*comparison.cases, *heavier):
        cells = []
        for size in SIZES_DEG:
            limit = comparison.limits.get((case, size))
            cells.append(
                Cell(number(limit.value), reason=limit.reason)
                if limit
                else Cell("–", reason="not computed")
            )
        rows.append((case if case in comparison.cases else f"{case}, with 1 kg more", *cells))
    return Table(
        "Physical limit: time-optimal moves of the full plant into the 2 % band",
        ("load", "35° to 30°, s", "20° to 35°, s", "5° to 35°, s"),
        tuple(rows),
        "Valve fully open one way, then the other, known to the last parameter, without hysteresis"
        " and noise.",
    )


def time_table(comparison: Comparison) -> Table:
    """Build the table of where the time of a step goes, nominal runs.

    Args:
        comparison: What was found.

    Returns:
        Limit, planned move and angle inside the 2 % band, in s, for each size of step.

    Example:
        >>> time_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for case in comparison.cases:
        for family in comparison.families:
            own = comparison.figures[family, case, "nominal"]
            cells = []
            for size in SIZES_DEG:
                limit = comparison.limits.get((case, size))
                plan = own.get(f"settling_planned_{size}_s")
                course = (limit, plan, own[f"settling_limited_{size}_s"])
                cells.append(" / ".join(number(f.value) if f else "–" for f in course))
            rows.append((case, family, *cells))
    return Table(
        "Time into the 2 % band: limit / planned move / angle, in s",
        ("load", "family", *STEPS),
        tuple(rows),
    )


NAMES = {
    "overshoot_percent": ("overshoot", "%"),
    "steady_deg": ("steady error", "°"),
    "swing_deg": ("swing", "°"),
    "rmse_0.2_Hz_deg": ("rmse at 0.2 Hz", "°"),
    "rmse_0.5_Hz_deg": ("rmse at 0.5 Hz", "°"),
    "rmse_1_Hz_deg": ("rmse at 1 Hz", "°"),
    **{f"ratio_{s}": (f"settling {s}° / limit", "") for s in (5, 15, 30)},
    "fallbacks": ("fallbacks", ""),
    "stop_impacts": ("stop impacts", ""),
}


def missed_table(comparison: Comparison) -> Table:
    """List every goal that is missed.

    Args:
        comparison: What was found.

    Returns:
        Load, family, figure, nominal and worst value, goal, and the obstacle in a sentence.

    Example:
        >>> missed_table(Comparison({}, {}, {}, {}, 0)).rows
        ()
    """
    rows: list[tuple[Cell | str, ...]] = []
    for case in comparison.cases:
        for family in comparison.families:
            first = figures_of(comparison, family, case, nominal=True)
            last = figures_of(comparison, family, case, nominal=False)
            for name, goal in goals_of(case).items():
                if name not in last or not is_missed(last[name], goal):
                    continue
                what, unit = NAMES.get(name, ("settling 15°", "s"))
                why = reason_of_miss(comparison, case, family, name, goal)
                rows.append(
                    (
                        case,
                        family,
                        what,
                        number(first[name].value),
                        number(last[name].value),
                        f"{goal:g} {unit}".strip(),
                        why,
                    )
                )
    note = (
        "The obstacles A, B and C are shown below, each with its runs; D: another family reaches"
        " the goal on the same plants."
        if rows
        else "Every goal is reached in every variation."
    )
    return Table(
        "Goals that are missed",
        ("load", "family", "figure", "nominal", "worst", "goal", "obstacle"),
        tuple(rows),
        note,
    )


def _kilogram(comparison: Comparison) -> str:
    """Say what the unknown kilogram does to the limit itself."""
    text = (
        f"{KILOGRAM}. The empty arm has 0.056 kg m²; one kilogram more makes it 0.192 kg m². A "
        "design that does not know of it either plans moves that the light arm could make, or "
        "plans for the heavier arm and stays behind the light arm's limit."
    )
    pair = [comparison.limits.get((f"{load} kg horizontal", 15)) for load in (0, 1)]
    light, heavy = (limit.value if limit else math.nan for limit in pair)
    if math.isnan(light + heavy):
        return text
    return (
        f"{text} The limit itself grows with the kilogram, for 15° from {number(light)} s to "
        f"{number(heavy)} s: a move in {number(2 * heavy)} s, twice the heavier arm's limit, is "
        f"{number(2 * heavy / light)} times that of the arm as known. What shorter plans cost is "
        "shown next, on the same plants."
    )


BY_HYSTERESIS = (
    f"{HYSTERESIS}. A step of 5° is settled within ± 0.1°. Hysteresis holds the arm by more than "
    "that until the feedback has found it, which takes as long as its bandwidth says, and no "
    "design knows of it."
)

BY_DELAY = (
    f"{DELAY}. Spool, held command and filter of the pressures lag by 5 to 6 ms. The feedforward "
    "leads by as much; the feedback cannot, and its margins (Ms, and Ms with every command one "
    "sample late) bound its speed. Where the time of a step goes:"
)

BY_MEAN = (
    "The mean pressure. One 5/3 valve commands the pressure difference only; the mean drifts "
    "between the bounds of the tables above with every move, and stiffness with it. The designs "
    "measure it and interpolate over it, but cannot choose it."
)


def _late(comparison: Comparison) -> list[str]:
    """Name the designs that do not bear a command one sample late."""
    late = [
        f"{family}, {case}"
        for family in comparison.families
        for case in comparison.cases
        if (family, case, LATE) in comparison.figures
        and not comparison.figures[family, case, LATE]["swing_deg"].value <= GOALS["swing_deg"]
    ]
    if not late:
        return []
    return [
        f"With every command 2 ms late, these swing by more than {GOALS['swing_deg']:g}°: "
        f"{'; '.join(late)}. The rig must answer within the sample."
    ]


def _pictures(comparison: Comparison) -> list[Picture]:
    found = []
    begin = BEGIN + HOLD * DRAWN_STEP
    for case in comparison.cases:
        runs = {
            family: comparison.curves[family, case, "steps"]
            for family in comparison.families
            if (family, case, "steps") in comparison.curves
        }
        if not runs:
            continue
        first = next(iter(runs.values()))
        seen = (first.time >= begin - 0.05) & (first.time <= begin + 0.6)
        figure = closed_loop_steps(
            first.time[seen] - begin,
            first.reference[seen],
            [
                ClosedLoopCurves(family, c.time[seen] - begin, c.angle[seen], c.command[seen])
                for family, c in runs.items()
            ],
        )
        slug = case.replace(" ", "-")
        found.append(
            Picture(
                f"step-{slug}",
                figure,
                f"{case}, 20° to 35° with muscle hysteresis: angle, error (dotted: ± 0.3°) and "
                "valve voltage.",
                f"a 15 degree step with {case}",
            )
        )
        sines: dict[str, Curves] = {
            family: comparison.curves[family, case, "sine 1 Hz"]
            for family in runs
            if (family, case, "sine 1 Hz") in comparison.curves
        }
        if sines:
            found.append(
                Picture(
                    f"sine-{slug}",
                    tracking_errors(sines),
                    f"{case}, sine of 15° at 1 Hz: reference and angle, and the error. The start "
                    "at full speed is caught up along a planned move.",
                    f"a sine at 1 Hz with {case}",
                )
            )
    first_family = comparison.families[0] if comparison.families else ""
    drift = {
        case: comparison.curves[first_family, case, "steps"]
        for case in comparison.cases
        if (first_family, case, "steps") in comparison.curves
    }
    if drift:
        found.append(
            Picture(
                "mean-pressure",
                pressure_drift(drift),
                f"Mean of the two pressures during the staircase ({first_family}): one valve does "
                "not command it.",
                "mean pressure over time for every load",
            )
        )
    return found


def write_comparison(comparison: Comparison, folder: Path, *, minutes: float = math.nan) -> Path:
    """Write results.json, the pictures and the page into a folder.

    Args:
        comparison: What was found.
        folder: Where to write; made if it does not exist.
        minutes: How long the comparison took, in minutes (60 s).

    Returns:
        The path of the page.

    Raises:
        WorkbenchError: If a file cannot be written.

    Example:
        >>> write_comparison.__name__
        'write_comparison'
    """
    page = comparison_page(comparison, minutes=minutes)
    write_whole(folder / "results.json", json_text(results(comparison)))
    for picture in page.pictures:
        save(picture, folder / "pictures")
    return write_page(page, folder / "report.html")


__all__ = ["CASES", "CHANGES", "comparison_page", "write_comparison"]
