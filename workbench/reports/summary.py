"""The outcome of a study as Markdown that reads well in a pull request."""

from __future__ import annotations

import re
from collections.abc import Iterable

from workbench.reports.figures.physical_limit import limit_blocks
from workbench.reports.figures.robustness import box_tables
from workbench.reports.page import Block, Words
from workbench.reports.study_tables import (
    change_tables,
    condition_tables,
    failed_tables,
    missed_tables,
    scenario_tables,
    scores_table,
)
from workbench.reports.tables import Cell, Mark, Table
from workbench.study.result import StudyResult
from workbench.verification.metrics import columns

MOST = 20
"""Rows of a table that are written out; a pull request is read, not searched."""

LONGEST = 60_000
"""Characters of a comment: GitHub takes 65,536."""

NO_BOX = (
    "The baseline keeps no results of the parameter box, so fewer plants that meet a requirement "
    "are not seen; `workbench bless` writes them."
)

ACCEPT = "Intended? `workbench bless DIR --baseline FILE` shows these changes and accepts them."

_MARKS: dict[Mark, str] = {"": "", "met": "✅", "missed": "❌", "open": "–"}


def summary(outcome: StudyResult) -> str:
    """Write the outcome as Markdown: what fails it first, what only informs folded."""
    study = outcome.study
    mark = ("✅ " if outcome.judged else "") if outcome.passed else "❌ "
    lines = [f"## {mark}{escaped(f'{study.name} {outcome.verdict()}: {outcome.headline()}')}", ""]
    against = [*condition_tables(outcome), *change_tables(outcome)]
    # What must be accepted has marks that say so.
    failing = [t for t in against if any(c.mark == "missed" for row in t.cells for c in row)]
    hard, soft = (missed_tables(outcome, hard=hard) for hard in (True, False))
    first = [scores_table(outcome)] if outcome.judgements else []
    lines += _written([*first, *hard, *failed_tables(outcome), *failing])
    if outcome.baseline is not None and outcome.robustness and not outcome.baseline.box:
        lines += [NO_BOX, ""]
    rest = [*(t for t in against if t not in failing), *soft]
    lines += _written(rest, fold=True)
    for case in study.cases.values():
        for name in study.scenarios:
            lines += _written(scenario_tables(outcome, name, case, columns("summary")))
    lines += _written([*limit_blocks(outcome), *box_tables(outcome)])
    if against:
        lines += [ACCEPT, ""]
    text = "\n".join(lines).rstrip()
    if len(text) > LONGEST:
        text = text[:LONGEST].rpartition("\n")[0]
        # A cut inside a folded list would swallow what follows.
        folded = text.count("<details>") > text.count("</details>")
        text += ("\n\n</details>" if folded else "") + "\n\nThe rest stands in `report.html`."
    return f"{text}\n\n{mark_of(study.name)}\n"


def mark_of(study: str) -> str:
    """Return the invisible mark by which the comment of a study is found again."""
    return f"<!-- workbench study {re.sub(r'[^A-Za-z0-9]+', '-', study).strip('-')} -->"


def escaped(text: str) -> str:
    r"""Return text in which nothing is Markdown, HTML, a mention or a reference to an issue.

    Example:
        >>> print(escaped("*a* | <b> @team #7 settling_time"))
        \*a\* \| &lt;b> &#64;team &#35;7 settling_time
    """
    text = " ".join(text.replace("\u200b", "").split())
    text = re.sub(r"([\\`*\[\]|~]|(?<!\w)_|_(?!\w))", r"\\\1", text)
    for sign, entity in ((r"#(?=\d)", "&#35;"), ("<", "&lt;"), ("@", "&#64;")):
        text = re.sub(sign, entity, text)
    return text


def _written(blocks: Iterable[Block], *, fold: bool = False) -> list[str]:
    """Return words and tables as lines; they end with an empty one."""
    lines: list[str] = []
    for block in blocks:
        if isinstance(block, Words):
            lines += [escaped(block.text), ""]
        elif isinstance(block, Table):
            title, rows = escaped(block.title), _rows(block.told())
            if fold:
                lines += ["<details>", f"<summary>{title}</summary>", "", *rows, "</details>", ""]
            else:
                lines += [f"### {title}", "", *rows]
    return lines


def _rows(table: Table) -> list[str]:
    head = tuple(map(Cell, table.headings))
    body = [f"| {' | '.join(map(_cell, row))} |" for row in (head, *table.cells[:MOST])]
    rule = "|" + "|".join(" --- " if i == 0 else " ---: " for i in range(len(head))) + "|"
    more = len(table.rows) - MOST
    notes = [f"and {more} more in `results.json`"] if more > 0 else []
    notes += [escaped(table.note)] if table.note else []
    return [body[0], rule, *body[1:], "", *(line for note in notes for line in (note, ""))]


def _cell(cell: Cell) -> str:
    words = (escaped(cell.text), _MARKS[cell.mark], f"({escaped(cell.reason)})" * bool(cell.reason))
    return " ".join(filter(None, words))
