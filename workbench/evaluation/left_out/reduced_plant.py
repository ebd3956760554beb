"""Diagnose the reduced plants and say what was found."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.diagnosis.stages import Diagnosis
from workbench.evaluation.kept import diagnosed, version
from workbench.evaluation.left_out.plan import LeftOut, recordings
from workbench.physics.library import library

SHOWN = {"rad": ("deg", 180.0 / math.pi), "N": ("N", 1.0)}
"""Unit and factor in which the held-out error of the first output is shown."""


def answer(case: LeftOut, jobs: int) -> dict[str, Any]:
    """Diagnose one reduced plant; returns its verdict with what is asked of it.

    ``right`` tells whether everything found is a right answer, and something was found if it had
    to; ``collinearity`` is the share of the right effect's signature that parameters reproduce;
    ``moved`` holds the relative changes of the parameters that left their priors farthest.
    """
    model = case.nominal()
    row = {"schema": "left_out/1", "case": case.name, "physics": case.physics, "version": version()}

    def more(found: Diagnosis) -> dict[str, Any]:
        assert found.verdict is not None
        names = {str(f.effect) for f in found.verdict.findings}
        scores = found.rounds[0][0].scores if found.rounds else ()
        own = next((s for s in scores if s.entry.name in case.answers), None)
        first = next(iter(found.verdict.units))
        unit, factor = SHOWN[found.verdict.units[first]]
        estimates = {e.name: e.value / e.prior.mean - 1.0 for e in found.base.refit.estimates}
        return {
            "right": names <= set(case.answers)
            and (bool(names) or case.collinear or not case.answers),
            "collinearity": own.collinearity if own else None,
            "expected_gain": own.gain if own else None,
            "unit": unit,
            "held_out": {k: factor * v[first] for k, v in found.verdict.fit.items() if v},
            "moved": dict(sorted(estimates.items(), key=lambda e: -abs(e[1]))[:2]),
        }

    with tempfile.TemporaryDirectory() as folder:
        fit, hold_out = recordings(case, Path(folder))
        entries = [
            e
            for e in library(
                model, outputs=tuple(q.name for q in model.outputs if q.name in fit[0])
            )
            if not case.tried or e.name in case.tried
        ]
        return diagnosed(
            row, model, fit, hold_out, jobs=jobs, entries=entries if case.tried else None, more=more
        )


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a reduced plant."""
    verdict = row["verdict"]
    found = ", ".join(
        f"{f['effect']} ("
        + ", ".join(f"{n} {v['value']:.3g} {v['unit']}" for n, v in f["parameters"].items())
        + ")"
        for f in verdict["findings"]
    )
    if "right" not in row:
        return f"{row['case']:<30} {verdict['verdict']}: {verdict.get('failure', '')}"
    errors, reproduced = row["held_out"], row["collinearity"]
    return (
        f"{row['case']:<30} {verdict['verdict']:<16} {found or '-':<40}"
        f" {'right' if row['right'] else 'WRONG'}, held out"
        f" {errors['refitted']:.4g} -> {errors['extended']:.4g} {row['unit']}"
        + (f", parameters reproduce {100 * reproduced:.1f} %" if reproduced is not None else "")
        + f"; {', '.join(f'{n} {100 * v:+.0f} %' for n, v in row['moved'].items())}"
        f" ({row['seconds']:.0f} s)"
    )
