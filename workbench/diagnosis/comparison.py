"""What the proof of a diagnosis shows: errors on held-out recordings and the located signal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.diagnosis.estimation.free_run import rms_of
from workbench.diagnosis.location.isolability import Isolability, isolability
from workbench.diagnosis.location.locate import groups_of
from workbench.diagnosis.location.missing_signal import MissingSignal
from workbench.diagnosis.stages import Diagnosis
from workbench.model.units import of_difference, parse_unit

_NOTHING_LEFT = ("nothing_missing", "parameter")


@dataclass(frozen=True)
class ErrorRow:
    """Free-run errors of one output over all held-out recordings.

    Args:
        spread: Standard deviation of the measurements, in ``unit``.
        noise: Noise of the sensor, in ``unit``.
        rmse: Root mean square error by model, in ``unit``.
    """

    output: str
    unit: str
    spread: float
    noise: float
    rmse: Mapping[str, float]

    def normalised(self, label: str) -> float:
        """Return the error of a model over the spread of the measurements, dimensionless."""
        return self.rmse[label] / self.spread if self.spread > 0 else math.nan

    def over_noise(self, label: str) -> float:
        """Return the error of a model over the noise of the sensor, dimensionless."""
        return self.rmse[label] / self.noise if self.noise > 0 else math.nan


@dataclass(frozen=True)
class Proof:
    """What the page of a diagnosis shows beyond the diagnosis itself.

    Args:
        located: The signal that is missing at each port of the first finding, or of the located
            group.
        note: Why there is no located signal; empty if there is one.
        isolability: What the recorded outputs can tell apart at all; None if nothing was run.
        ports: Ports of all findings, or of the located group.
    """

    located: tuple[MissingSignal, ...]
    errors: tuple[ErrorRow, ...]
    note: str = ""
    isolability: Isolability | None = None
    ports: tuple[str, ...] = ()


def proof_of(diagnosis: Diagnosis) -> Proof:
    """Collect what the proof page shows.

    The located signal of something that was found is estimated from the held-out recordings; the
    law beside it was fitted to the others.
    """
    if not diagnosis.runs:
        return Proof((), (), "the diagnosis did not get as far as the held-out recordings")
    errors = error_rows(diagnosis)
    told = isolability(diagnosis.nominal, outputs=[row.output for row in errors])
    ports = located_ports(diagnosis)
    if not ports:
        return Proof((), errors, "nothing was located", told)
    found = tuple(dict.fromkeys(p for c, _ in diagnosis.accepted for p in c.entry.ports)) or ports
    known = {port.name for port in diagnosis.nominal.ports}
    shown = diagnosis.validated.missing[:1] if diagnosis.validated else ()
    signals = tuple(signal for first in shown for signal in first if signal.port in known)
    why = diagnosis.validated.not_shown if diagnosis.validated else ""
    return Proof(signals, errors, "" if signals else why, told, found)


def located_ports(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return the ports of the first finding; else of the located group, if something is missing."""
    if diagnosis.accepted:
        return diagnosis.accepted[0][0].entry.ports
    if diagnosis.nonparametric is not None and diagnosis.nonparametric.accepted:
        return diagnosis.nonparametric.ports
    verdict = diagnosis.concluded
    if diagnosis.before is None or verdict is None or verdict.kind in _NOTHING_LEFT:
        return ()
    if verdict.findings:
        return verdict.findings[0].where
    return groups_of(diagnosis.base.model)[diagnosis.before.best]


def error_rows(diagnosis: Diagnosis) -> tuple[ErrorRow, ...]:
    """Return the free-run errors over all held-out recordings, output by output."""
    verdict = diagnosis.concluded
    noise = verdict.fit.get("noise_floor", {}) if verdict else {}
    labels = [label for label, runs in diagnosis.runs.items() if runs]
    first = list(diagnosis.runs[labels[0]].values()) if labels else []
    errors = {k: rms_of([run.rmse for run in diagnosis.runs[k].values()]) for k in labels}
    units = {q.name: of_difference(q.display_unit) for q in diagnosis.nominal.outputs}
    rows = []
    for i, name in enumerate(first[0].used if first else ()):
        spread = float(np.nanstd(np.concatenate([run.measured[:, i] for run in first])))
        unit, size = units[name], parse_unit(units[name]).factor
        read = {label: rms[name] / size for label, rms in errors.items()}
        rows.append(ErrorRow(name, unit, spread / size, noise.get(name, math.nan) / size, read))
    return tuple(rows)
