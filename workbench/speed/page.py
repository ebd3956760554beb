"""The page of the benchmark: each figure reached or not and why, and peers."""

from __future__ import annotations

from workbench.reports.page import Answers, Page, Section, again
from workbench.reports.pictures import Picture
from workbench.reports.style import key, label, new_figure, palette
from workbench.reports.tables import Cell, Mark, Table, number
from workbench.speed.benchmark import Benchmark, machine
from workbench.speed.measure import Comparison, Figure

_MARKS: dict[bool | None, Mark] = {True: "met", False: "missed", None: "open"}


def benchmark_page(found: Benchmark, *, command: str) -> Page:
    """Lay out the page of the benchmark."""
    missed = [f for f in found.figures if f.reached is False]
    reached = sum(f.reached is True for f in found.figures)
    met = [f for f in found.figures if f.reached is not False]
    tables = (("Missed", missed), ("Reached", met))
    shown = tuple(_figures(title, figures) for title, figures in tables if figures)
    sections = [Section("figures", "Figures to reach", shown)]
    if found.comparisons:
        drawn = _ratios(found.comparisons)
        ways = tuple(_ways(c) for c in found.comparisons)
        sections.append(Section("peers", "Beside other tools, in the same run", (drawn, *ways)))
    words = "; ".join(f.what for f in missed) or "nothing"
    return Page(
        "How fast the workbench is",
        f"{reached} of {len(found.figures)} figures are reached. Comparisons are ratios of"
        " processor times measured in one run, each with the accuracy that it reached.",
        (*sections, *again(command)),
        first=(Answers((("reached", f"{reached} of {len(found.figures)}"), ("missed", words))),),
        facts=(
            ("machine", machine()),
            ("load at the beginning", f"{found.load:.1f}"),
            ("took", f"{found.seconds:.0f} s"),
        ),
    )


def _figures(title: str, figures: list[Figure]) -> Table:
    return Table.of(
        title,
        figures,
        {
            "what": lambda f: f.what,
            "measured": lambda f: Cell(number(f.value, unit=_unit(f.unit)), _MARKS[f.reached]),
            "to reach": lambda f: f"{f.bound} {_unit(f.unit)}",
            "what it consists of, and what stands in the way": lambda f: f.breakdown,
        },
    )


def _unit(unit: str) -> str:
    return unit.replace("x", "×", 1) if unit.split()[0] == "x" else unit


def _ways(comparison: Comparison) -> Table:
    rows = []
    for way in comparison.ways:
        low, middle, high = comparison.ratio(way.name)
        time = number(1e3 * way.times.median) if way.times else "–"
        ratio = f"{number(middle)} ({number(low)} to {number(high)})" if way.times else "–"
        rows.append((way.name, time, ratio, number(way.error, 2), way.remark))
    time, times = f"ms of processor time per {comparison.work}", "× the workbench's time (spread)"
    head = ("way", time, times, comparison.error, "remark")
    return Table(comparison.title, head, tuple(rows), comparison.note)


def _ratios(comparisons: list[Comparison]) -> Picture:
    """Draw how many times longer each way took, on a logarithmic axis."""
    rows = [
        (c, w.name, c.ratio(w.name)) for c in comparisons for w in c.ways[1:] if w.times is not None
    ]
    figure, (axes,) = new_figure([0.24 * len(rows) + 0.2])
    colours = palette()
    shown = {c.name: colours[i % len(colours)].light for i, c in enumerate(comparisons)}
    named: set[str] = set()
    for place, (comparison, _, (low, middle, high)) in enumerate(rows):
        name = comparison.name.replace("-", " ")
        axes.errorbar(
            [middle],
            [place],
            xerr=[[middle - low], [high - middle]],
            fmt="o",
            color=shown[comparison.name],
            capsize=3,
            label="" if name in named else name,
        )
        named.add(name)
    axes.axvline(1.0, color=colours[0].light, linewidth=1.0)
    axes.set_xscale("log")
    axes.margins(x=0.05)
    axes.set_yticks(range(len(rows)), [_short(name) for _, name, _ in rows])
    axes.invert_yaxis()
    label(axes, x="time over the workbench's (a ratio)")
    key(axes, columns=2)
    caption = (
        "Time of other ways over the workbench's, median and spread; the tables tell how exact."
    )
    return Picture("ratios", figure, caption, "ratios of times of other tools")


def _short(name: str) -> str:
    """Leave out of a name what the tables tell."""
    for part in (" per sample", " input_output_response", " of fixed step", " over a grid"):
        name = name.replace(part, "")
    head, _, tail = name.partition(",")
    return f"{head} (compiled)" if "compiled" in tail else head
