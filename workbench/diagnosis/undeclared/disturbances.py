"""What equations may leave out at ports for which a plant declares no disturbance."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import clipped
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.process_noise import likely_scale
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Model
from workbench.recordings.recording import Recording
from workbench.simulation import simulate

_INDEPENDENT = 1e-6
"""Part by which directions, of length 1, must differ to be more than one."""


def with_disturbances(
    model: Model, recordings: Sequence[Recording]
) -> tuple[Model, dict[str, float]]:
    """Take what is left out from the signals at ports, unless the plant declares it at any.

    Returns:
        The model, and the root mean square of those signals along the recordings, in SI, by port.
    """
    declares = any(p.disturbance or p.relative_disturbance for p in model.ports)
    sizes: dict[str, float] = {}
    if declares and not model.traits.opened:
        return model, sizes
    for recording in recordings:
        with contextlib.suppress(WorkbenchError):  # Refit and checks say what is wrong with it.
            for name, rms in _signals_along(model, observe(model, recording)).items():
                sizes[name] = max(rms, sizes.get(name, 0.0))
    return _with_sizes(model, sizes), sizes


def opened(model: Model, recordings: Sequence[Recording]) -> tuple[Model, tuple[str, ...]]:
    """Open ports where the author of a plant trusts its equations, and give them disturbances.

    Args:
        model: A plant that declares noise, or has taken it from its recordings.

    Returns:
        The plant with further ports, the same one where there are none; their names. An input
        that stays as it is is no place to look at: an error of it is one of a parameter. Nor is a
        rate that the author's own ports change as it may be changed: what acts there acts at them.
    """
    further = model.opened()
    still = {
        f"{q.name}.command"
        for q in model.inputs
        if all(np.ptp(r[q.name]) == 0.0 for r in recordings if q.name in r)
    }
    known = still | {q.name for q in model.ports} | _carried(model)
    new = tuple(q.name for q in further.ports if q.name not in known)
    return (with_disturbances(further, recordings)[0], new) if new else (model, ())


def _carried(model: Model) -> set[str]:
    """Return the ports of rates that the ports of a plant together change, each by itself."""
    raised = model.exact.function("by_port", model.exact.rates_by_port)
    scales = np.array([q.scale for q in model.states])[:, None]
    at = np.asarray(raised(model.initial_state(), model.nominal_input, model.values)) / scales
    at = at[:, np.all(np.isfinite(at), axis=0) & np.any(at != 0.0, axis=0)]
    directions, sizes, _ = np.linalg.svd(at / np.linalg.norm(at, axis=0), full_matrices=False)
    spanned = np.sum(directions[:, sizes > _INDEPENDENT] ** 2, axis=1)
    found = zip(model.states, spanned, strict=True)
    return {f"{q.name}.rate" for q, part in found if part > 1.0 - _INDEPENDENT}


def _signals_along(model: Model, seen: Observed) -> dict[str, float]:
    """Return the rms of the signal at each port that acts on a rate, in its SI unit."""
    acting = ca.DM(model.exact.rates_by_port.sparsity(), 1).full().any(axis=0)
    ports = [
        port
        for port, acts in zip(model.ports, acting, strict=True)
        if (acts or not acting.any()) and not port.name.endswith((".command", ".reading"))
    ]
    inputs = clipped(model, seen)
    if not seen.diverges:
        with contextlib.suppress(NumericalError):
            run = simulate(
                model, inputs, sample_time=seen.sample_time, start=seen.start, check=False
            )
            return _rms({port.name: run.signals[port.name] for port in ports})
    # The measurements hold what would run away; how much is left out shows in how it is held.
    trial = _with_sizes(model, {port.name: port.scale for port in ports})
    scale = likely_scale(trial, [seen], {})
    states = filter_of(trial, seen, scale).run(seen, trial.values).states
    trace = trial.exact
    signals = trace.along(states, inputs, trial.values, trace.signals)[0][:, :, 0]
    named = dict(zip(trace.signal_names, signals.T, strict=True))
    return _rms({port.name: named[port.name] for port in ports})


def _with_sizes(model: Model, sizes: Mapping[str, float]) -> Model:
    return replace(model, traits=replace(model.traits, sizes=tuple(sizes.items())))


def _rms(signals: Mapping[str, Vector]) -> dict[str, float]:
    sizes = {name: float(np.sqrt(np.mean(v**2))) for name, v in signals.items()}
    return {name: rms for name, rms in sizes.items() if rms > 0}
