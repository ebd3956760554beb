"""What a verdict claims, as a round is scored by it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.checked_json import TableShape, listed, named, number, optional, read_json, text
from workbench.diagnosis.verdict import upgraded
from workbench.evaluation.answer_key import Names


@dataclass(frozen=True)
class Answer:
    """What one verdict claims.

    Args:
        findings: Pairs of the class of names (the named one first; empty without a name) and the
            groups of ports, the most likely first.
        improves: Whether the extended model is better than the refitted one on held-out recordings.
        over_noise: Error of the extended model over the sensors' noise, root mean square over the
            outputs, dimensionless; NaN if it was not given.
    """

    case: str
    kind: str
    findings: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
    improves: bool
    over_noise: float = math.nan

    @property
    def names(self) -> int:
        """How many effects it names."""
        return sum(bool(names) for names, _ in self.findings)


def read_answer(path: str | Path, case: str, names: Names) -> Answer:
    """Read what a ``verdict.json`` claims.

    Raises:
        WorkbenchError: If the file cannot be read or is no verdict.
    """
    data = read_json(path, "verdict", _VERDICT, fix="write it with 'workbench diagnose'")
    return answer_of(upgraded(data, f"verdict {str(path)!r}"), case, names)


_ERRORS = optional(named(optional(number)))
_HELD_OUT = TableShape({}, dict.fromkeys(("extended", "refitted", "noise_floor"), _ERRORS))
_FINDING = TableShape(
    {}, {"effect": optional(text), "class": optional(listed(text)), "where": optional(listed(text))}
)
_VERDICT = TableShape(
    {"schema": text, "verdict": text},
    {
        "findings": optional(listed(_FINDING)),
        "fit": optional(TableShape({}, {"held_out": optional(_HELD_OUT)})),
    },
)


def answer_of(data: Mapping[str, Any], case: str, names: Names) -> Answer:
    """Return what the content of a ``verdict.json`` claims."""
    data = upgraded(data) if data else data
    findings = []
    for finding in data.get("findings") or ():
        effect = finding.get("effect")
        named = bool(effect) and effect != "nonparametric"
        alike = tuple(finding.get("class") or ()) if named else ()
        members = tuple(dict.fromkeys((effect, *alike))) if named else ()
        groups = tuple(dict.fromkeys(names.group(port) for port in finding.get("where") or ()))
        findings.append((members, groups))
    held_out = (data.get("fit") or {}).get("held_out") or {}
    extended = held_out.get("extended") or {}
    return Answer(
        case,
        data["verdict"],
        tuple(findings),
        error_ratio(extended, held_out.get("refitted") or {}) < 1.0,
        error_ratio(extended, held_out.get("noise_floor") or {}),
    )


LARGEST_RATIO = 1.5
"""Held-out error over that of the true model which still counts as within the noise."""


def error_ratio(above: Mapping[str, Any], below: Mapping[str, Any]) -> float:
    """Return the ratio of errors, root mean square over the outputs; NaN if there are none."""
    ratios = [
        float(value) / float(below[name])
        for name, value in above.items()
        if value is not None and below.get(name)
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else math.nan
