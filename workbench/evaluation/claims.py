"""What a verdict claims, as a round is scored by it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.diagnosis.verdict import SCHEMA
from workbench.errors import WorkbenchError
from workbench.evaluation.answer_key import Names, read_json


@dataclass(frozen=True)
class Answer:
    """What one verdict claims.

    Args:
        case: Name of the case.
        kind: The verdict in one word.
        findings: Pairs of the class of names (the named one first; empty without a name) and the
            groups of ports, the most likely first.
        improves: Whether the extended model is better than the refitted one on held-out recordings.
        over_noise: Error of the extended model over the sensors' noise, root mean square over the
            outputs, dimensionless; NaN if it was not given.

    Example:
        >>> Answer("one", "named", ((("tilt_gravity",), ("motion",)),), True, 1.2).names
        1
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

    Args:
        path: The file.
        case: Name of the case.
        names: Groups of ports.

    Returns:
        The claims.

    Raises:
        WorkbenchError: If the file cannot be read or is no verdict.

    Example:
        >>> read_answer("no such file", "one", Names({}, {}))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: verdict 'no such file' cannot be read: no such file ...
    """
    data = read_json(path, "verdict")
    if data.get("schema") != SCHEMA or not isinstance(data.get("verdict"), str):
        raise WorkbenchError(
            f"verdict {str(path)!r} has the schema {data.get('schema')!r}; it must be {SCHEMA!r}"
        )
    findings = []
    for finding in data.get("findings") or ():
        effect = finding.get("effect")
        named = bool(effect) and effect != "free_form"
        alike = tuple(finding.get("class") or ()) if named else ()
        members = tuple(dict.fromkeys((effect, *alike))) if named else ()
        groups = tuple(dict.fromkeys(names.group(port) for port in finding.get("where") or ()))
        findings.append((members, groups))
    held_out = (data.get("fit") or {}).get("held_out") or {}
    after, noise = _level(held_out, "extended"), _level(held_out, "noise_floor")
    return Answer(
        case,
        data["verdict"],
        tuple(findings),
        _ratio(after, _level(held_out, "refitted")) < 1.0,
        _ratio(after, noise),
    )


def _level(held_out: Mapping[str, Any], label: str) -> dict[str, float]:
    values = held_out.get(label) or {}
    return {k: float(v) for k, v in values.items() if isinstance(v, (int, float)) and v > 0}


def _ratio(above: Mapping[str, float], below: Mapping[str, float]) -> float:
    ratios = [above[name] / below[name] for name in above if name in below]
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else math.nan
