"""The files of a study: results, summary, JUnit tests and the page."""

from __future__ import annotations

from pathlib import Path

from workbench.files import json_text, write_whole
from workbench.reports.figures.linear_analysis import LINEAR, linear_blocks
from workbench.reports.page import Commands, Method, Page, Section, html
from workbench.reports.study_page import study_page
from workbench.study.junit import junit
from workbench.study.linear_loop import LoopAnalysis
from workbench.study.result import StudyResult, installed_version
from workbench.study.study import Study
from workbench.study.summary import summary


def write_study_files(
    outcome: StudyResult, folder: str | Path, *, command: str = ""
) -> tuple[Path, ...]:
    """Write what a study found."""
    place = Path(folder)
    texts = {
        "results.json": json_text(outcome.table()),
        "summary.md": summary(outcome),
        "junit.xml": junit(outcome),
        "report.html": html(study_page(outcome, command=command)),
    }
    # All are made before the first is written: a mistake in one leaves the earlier results.
    return tuple(write_whole(place / name, text) for name, text in texts.items())


def linear_page(study: Study, loops: tuple[LoopAnalysis, ...], *, command: str = "") -> Page:
    """Build the page of the linear analysis alone."""
    worst = min((a.disk_margin for a in loops if a.stable), default=float("nan"))
    lead = (
        f"{len(study.controllers)} controllers at {len(study.points)} operating points; the "
        f"smallest disk margin is {worst:.2g}. No run was made."
    )
    again = [Commands((command,))] if command else []
    blocks = (*linear_blocks(study, loops), Method(LINEAR.methods), *again)
    section = Section(LINEAR.name, LINEAR.title, blocks)
    facts = (("workbench", installed_version()),)
    return Page(f"Linear analysis of study {study.name}", lead, (section,), facts=facts)
