"""The page of a refit: estimates with intervals, held-out errors, pictures."""

from __future__ import annotations

import math
import re

from workbench.computing.counted import in_words
from workbench.diagnosis.estimation.refit_result import Estimate
from workbench.diagnosis.refit_report import AT_NOISE, RefitReport
from workbench.model.units import to_si
from workbench.reports.figures.diagnosis import run_pictures
from workbench.reports.figures.study_traces import written
from workbench.reports.page import Answers, Block, Method, Page, Section, Words, again, methods
from workbench.reports.pictures import Picture
from workbench.reports.tables import Table, interval, number


def refit_page(report: RefitReport, *, command: str) -> Page:
    """Lay out the page of a refit."""
    task = report.problem
    blocks: list[Block] = [_estimates(report)]
    if task.published:
        blocks.append(_published(report))
    found = report.refit
    drawn = pictures(report)
    sections = [Section("estimates", "Estimates", tuple(blocks))]
    if report.rows:
        notes = (Words(f"{note}.", "note") for note in report.notes)
        judged: tuple[Block, ...] = (*drawn[1:], _errors(report), *notes, Method(methods("refit")))
        sections.insert(0, Section("held-out", "Recordings that the refit has not seen", judged))
    sections += again(command)
    return Page(
        f"Refit: {task.title}",
        f"Parameters estimated from {len(task.fit)} recording(s) and judged on"
        f" {len(task.hold_out) + len(task.in_loop)} other run(s).",
        tuple(sections),
        first=(_answers(report), *drawn[:1]),
        facts=(
            ("converged", "yes" if found.converged else "no"),
            ("steps", str(found.iterations)),
            ("time", f"{report.seconds:.1f} s"),
            ("work", in_words(report.work)),
        ),
    )


def _answers(report: RefitReport) -> Answers:
    """Say what the refit is worth on recordings that it has not seen, and what to mistrust."""
    found = report.refit
    one = report.rows[0].recording if report.rows else ""
    errors = [
        f"{r.output.replace('_', ' ')} {number(r.nominal)} → {number(r.refitted)} {written(r.unit)}"
        f" (noise {number(r.noise, 2)})"
        for r in report.rows
        if r.recording == one
    ]
    bound = [e.name for e in found.estimates if e.on_bound]
    entries = (
        ("do parameters explain it", _verdict(report) if report.rows else "nothing was held out"),
        (f"error on {one.split('/')[-1].replace('_', ' ')}", ", ".join(errors)),
        ("not determined", "; ".join(found.unidentifiable)),
        ("recordings disagree on", "; ".join(found.disagreements)),
        ("on a bound", f"{', '.join(bound)}: missing physics may pull there" if bound else ""),
    )
    return Answers(tuple((question, answer) for question, answer in entries if answer))


def pictures(report: RefitReport) -> tuple[Picture, ...]:
    """Draw free runs on each held-out recording that the refitted model runs to its end."""
    drawn: list[Picture] = []
    for nominal, refitted in zip(report.nominal, report.refitted, strict=True):
        if not refitted.finite:
            continue
        title = refitted.name
        own = [r for r in report.rows if r.recording == title]
        known = [r for r in own if math.isfinite(r.noise)]
        noise = {r.output: float(to_si(r.noise, r.unit)) for r in known}
        file = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
        files = f"held-out-{file}", f"errors-{file}"
        runs = {"nominal": nominal, "refitted": refitted}
        drawn += run_pictures(report.problem.model, runs, noise, title, files)
    return tuple(drawn)


def _estimates(report: RefitReport) -> Table:
    return Table.of(
        "Refitted parameters",
        report.refit.as_read,
        {
            "parameter": lambda e: e.name,
            "unit": lambda e: e.read(e.value, e.std)[2],
            "before": lambda e: number(e.read(e.prior.mean, 0.0)[0], 4),
            "estimate": lambda e: number(e.read(e.value, e.std)[0], 5),
            "95 % interval": _interval,
        },
        "Intervals allow for prediction errors that last as long as a response takes to show.",
    )


def _interval(estimate: Estimate) -> str:
    low, high = (estimate.read(end, 0.0)[0] for end in estimate.interval)
    return interval(low, high, 5) + (" (on a bound)" if estimate.on_bound else "")


def _published(report: RefitReport) -> Table:
    return Table(
        "Beside published values",
        ("parameter", "estimate", "published", "difference in %", "in standard deviations"),
        tuple(
            (
                name,
                number(value, 5),
                number(published, 5),
                number(100 * (value / published - 1), 2),
                number(sigmas, 2),
            )
            for name, value, published, sigmas in report.differences()
        ),
        report.problem.published_from,
    )


def _errors(report: RefitReport) -> Table:
    return Table.of(
        "Free-run errors, rms",
        report.rows,
        {
            "recording": lambda r: r.recording,
            "output": lambda r: r.output,
            "unit": lambda r: r.unit,
            "spread": lambda r: number(r.spread),
            "nominal": lambda r: number(r.nominal),
            "refitted": lambda r: number(r.refitted),
            "noise-limited": lambda r: number(r.limited),
            "noise": lambda r: number(r.noise),
        },
    )


def _verdict(report: RefitReport) -> str:
    worst = report.times_noise
    if report.reaches_floor:
        rest = "nothing" if worst < AT_NOISE else "little"
        return (
            f"The refitted model is off by {worst:.2g} times the noise or less on every held-out"
            f" recording: {rest} in them asks for further physics."
        )
    if all(row.as_expected for row in report.rows):
        return (
            "The errors may be those that the uncertainty of start and parameters leaves; they are"
            " too far above the noise of the measurements to say whether the model lacks"
            " anything."
        )
    times = f", at up to {worst:.2g} times" if math.isfinite(worst) else ""
    return (
        f"The refitted model stays above the noise on held-out recordings{times}: the model lacks"
        " something, or the recordings do not determine it well enough."
    )
