"""All checks of a recording, in the order in which one corrects for the next."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from workbench.display import aligned_table
from workbench.errors import check_choice

if TYPE_CHECKING:
    from workbench.model import Model
from workbench.recordings.checks.check import CHECKS, Finding, Result
from workbench.recordings.checks.expected import expectations
from workbench.recordings.recording import Recording


@dataclass(frozen=True, eq=False)
class CheckReport:
    """What the checks found in a recording."""

    name: str
    checks: tuple[Finding, ...]
    recording: Recording
    original: Recording

    @property
    def fit(self) -> bool:
        """Whether the recording can be judged."""
        return all(check.result != "unfit" for check in self.checks)

    @property
    def result(self) -> Result:
        """The worst result of all checks."""
        found = {check.result for check in self.checks}
        return "unfit" if "unfit" in found else "corrected" if "corrected" in found else "pass"

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Names of the checks with a suspicion that they cannot decide."""
        return tuple(check.name for check in self.checks if check.doubt)

    def check(self, name: str) -> Finding:
        """Return a check by its name, such as ``gaps``; an unknown name is a `WorkbenchError`."""
        check_choice("check", name, [c.name for c in self.checks])
        return next(c for c in self.checks if c.name == name)

    def as_data(self) -> list[dict[str, str]]:
        """Return one entry per check, as a verdict lists them."""
        return [check_row(self.name, c.name, c.result, c.note) for c in self.checks]

    def __str__(self) -> str:
        rows = [(c.name, c.result, c.note) for c in self.checks]
        open_ = [c.name for c in self.checks if c.result == "not checked"]
        tail = f", doubtful: {', '.join(self.doubtful)}" if self.doubtful else ""
        tail += f", not checked: {', '.join(open_)}" if open_ else ""
        tail += " (see why below)" if tail else ""
        table = aligned_table(("check", "result", "note"), rows)
        return f"{self.name}: {self.result}{tail}\n{table}"


def check_row(recording: str, check: str, result: Result, note: str) -> dict[str, str]:
    """Return what a check says of a recording, as a verdict lists it."""
    return {"recording": recording, "check": check, "result": result, "note": note}


def check_recording(
    recording: Recording,
    *,
    model: Model | None = None,
    required: Iterable[str] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    signs: Mapping[tuple[str, str], int] | None = None,
) -> CheckReport:
    """Judge whether a recording is fit, and correct what can be corrected.

    The checks of the registry `CHECKS` run in their order; an unfit foundation (the time base,
    gaps, a required measurement that is constant) ends them.

    Args:
        model: Model whose inputs and outputs are required, with their limits; None without.
        required: Names of the signals that must be fit; by default those of the model, else those
            whose column states a unit or stands in a mapping file.
        ranges: Plausible ranges by signal, in SI.
        signs: Sign of the response by (cause, response); by default as the model has them.

    Example:
        >>> import numpy as np
        >>> from workbench.recordings import Signal
        >>> time = np.arange(1000) * 0.002
        >>> noise = np.random.default_rng(0).normal(0.0, 1e-3, 1000)
        >>> trial = Recording("trial", time, (Signal("angle", np.sin(time) + noise, "rad"),))
        >>> report = check_recording(trial)
        >>> floors = report.check("noise floor").values["floors"]
        >>> report.result, round(floors["angle"].floor, 4)
        ('pass', 0.001)
    """
    expected = expectations(recording, model=model, required=required, ranges=ranges, signs=signs)
    findings: list[Finding] = []
    current = recording
    for check in sorted(CHECKS.members().values(), key=lambda c: (c.order, c.name)):
        found = check(current, expected)
        findings.append(found)
        current = found.recording or current
        if found.result == "unfit" and check.foundation:
            break
    return CheckReport(recording.name, tuple(findings), current, recording)
