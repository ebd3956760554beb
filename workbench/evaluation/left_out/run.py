"""Diagnose the reduced plants and tabulate what was found."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.stages import Diagnosis
from workbench.evaluation.kept import keep
from workbench.evaluation.left_out.plan import PLAN, LeftOut, recordings
from workbench.files import write_whole
from workbench.physics.library import Hypothesis, library
from workbench.recordings.aligned_table import aligned_table

SHOWN = {"rad": ("deg", 180.0 / math.pi), "N": ("N", 1.0)}
"""Unit and factor in which the held-out error of the first output is shown."""


@dataclass(frozen=True)
class Row:
    """What the diagnosis of one reduced plant said.

    Args:
        alike: Names that the verdict cannot tell from the first.
        right: Whether everything found is a right answer, and something was found if it had to.
        collinearity: Share of the right effect's signature that parameters imitate, a
            fraction; NaN for none.
        expected: Log likelihood that the right effect is expected to gain, dimensionless;
            NaN for none.
        size: Size of what was found, as printed.
        refitted: Held-out error of the refitted reduced plant, in ``unit``.
        extended: Held-out error of the extended model, in ``unit``.
        moved: Parameters of the refitted plant that are farthest from the extended one's.
        seconds: Time that the diagnosis took, in s.
    """

    left_out: str
    trial: str
    kind: str
    found: tuple[str, ...]
    alike: tuple[str, ...]
    right: bool
    collinearity: float
    expected: float
    size: str
    unit: str
    refitted: float
    extended: float
    moved: str
    seconds: float


def run(
    case: LeftOut,
    folder: Path,
    *,
    seconds: float = 10.0,
    only: Sequence[str] | None = None,
    jobs: int = 2,
    progress: Callable[[str], None] | None = None,
) -> tuple[Row, Diagnosis]:
    """Diagnose one reduced plant.

    Args:
        seconds: Length of a recording of the arm, in s.
        only: Names of the effects to try; the whole library by default.
        progress: Called with a line of text before each step.

    Returns:
        Its row of the table, and the diagnosis.
    """
    fit_on, hold_out = recordings(case.trial, folder, seconds=seconds)
    model = case.nominal()
    entries: list[Hypothesis] | None = None
    if only is not None:
        outputs = tuple(q.name for q in model.outputs if q.name in fit_on[0])
        entries = [e for e in library(model, outputs=outputs) if e.name in only]
    found = diagnose(model, fit_on, hold_out, entries=entries, jobs=jobs, progress=progress)
    return row_of(case, found), found


def run_all(out: Path, *, jobs: int = 2) -> Iterator[str]:
    """Diagnose every reduced plant with the whole library; yields one line per plant.

    ``out`` receives each verdict and ``table.txt``.
    """
    rows = []
    for i, case in enumerate(PLAN):
        with tempfile.TemporaryDirectory() as folder:
            row, found = run(case, Path(folder), jobs=jobs)
        rows.append(row)
        assert found.verdict is not None
        kept = {"row": vars(row), "verdict": found.verdict.as_data()}
        keep(out / f"{i}-{case.trial}.json", kept)
        yield f"{row.left_out}, {row.trial}: {row.kind} ({row.seconds:.0f} s)"
    write_whole(out / "table.txt", table(rows) + "\n")


def row_of(case: LeftOut, diagnosis: Diagnosis) -> Row:
    """Return the row of a finished diagnosis."""
    verdict = diagnosis.verdict
    assert verdict is not None
    names = tuple(str(f.effect) for f in verdict.findings)
    scores = diagnosis.rounds[0][0].scores if diagnosis.rounds else ()
    own = next((s for s in scores if s.entry.name in case.answers), None)
    first = next(iter(verdict.units))
    unit, factor = SHOWN[verdict.units[first]]
    size = ", ".join(
        f"{name} {v.value:.3g} ± {v.std:.1g}{'' if v.unit == '1' else ' ' + v.unit}"
        for f in verdict.findings
        for name, v in f.parameters.items()
    )
    silent_is_right = not case.answers or case.absorbed
    return Row(
        case.name,
        case.trial,
        verdict.kind,
        names,
        verdict.findings[0].alike[1:] if verdict.findings else (),
        set(names) <= set(case.answers) and (bool(names) or silent_is_right),
        own.collinearity if own else math.nan,
        own.gain if own else math.nan,
        size,
        unit,
        factor * verdict.fit["refitted"][first],
        factor * verdict.fit["extended"][first],
        _moved(diagnosis),
        verdict.seconds,
    )


def _moved(diagnosis: Diagnosis, most: int = 2) -> str:
    """Say which parameters of the refitted plant are on a bound or far from their priors."""
    refit = diagnosis.base.refit
    far = sorted(refit.estimates, key=lambda e: -abs(e.value / e.prior.mean - 1.0))
    return ", ".join(
        f"{e.name} {100 * (e.value / e.prior.mean - 1.0):+.0f} %"
        + (" (on its bound)" if e.on_bound else "")
        for e in far[:most]
    )


def table(rows: Sequence[Row]) -> str:
    """Return the rows as an aligned table."""
    head = ("left out", "data", "verdict", "found", "held out: refitted", "extended", "absorbed")
    cells = [
        (
            r.left_out,
            r.trial,
            r.kind,
            ", ".join(r.found) or "-",
            f"{r.refitted:.4g} {r.unit}",
            f"{r.extended:.4g} {r.unit}",
            "-" if math.isnan(r.collinearity) else f"{100 * r.collinearity:.1f} %",
        )
        for r in rows
    ]
    lines = [aligned_table(head, cells, width=None)]
    for r in rows:
        lines += [f"{r.left_out}, {r.trial}:"]
        lines += [f"  size {r.size}"] if r.size else []
        lines += [f"  cannot be told from {', '.join(r.alike)}"] if r.alike else []
        if not math.isnan(r.expected):
            lines += [f"  expected gain of log likelihood {r.expected:.0f}"]
        lines += [f"  refitted without it: {r.moved}"]
    return "\n".join(line.rstrip() for line in lines)
