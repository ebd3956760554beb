"""Evidence for a law without a name: the located signal, and what could explain it.

The unknown input at some ports is smoothed. Beside it stand what these ports see locally, or a pair
of ports that acts on the rates in the same way, and what other values of the free parameters would
add at the same place.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.location.locate import PARALLEL, directions_of
from workbench.diagnosis.location.unknown_input import unknown_input
from workbench.diagnosis.nonparametric.dependence import Evidence, Site
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.model import index_of

_ROWS = 1500
_LEAST_KNOWN = 100
_SAME = 0.9999


def gather(
    model: Model, recordings: Sequence[Observed], ports: Sequence[str], priors: Sequence[Prior]
) -> Evidence:
    """Smooth the unknown input at some ports and collect what could explain it.

    Args:
        ports: One port, or ports that share a law, such as those of both muscles.

    Raises:
        WorkbenchError: If a port does not exist.
        NumericalError: If the filter cannot follow a recording.
    """
    parts = [unknown_input(model, observed, ports) for observed in recordings]
    every = max(1, sum(len(part.time) for part in parts) // _ROWS)
    x, u, signal, std, time = (
        np.concatenate([getattr(part, of)[::every] for part in parts])
        for of in ("states", "inputs", "signal", "std", "time")
    )
    # While a machine rests, its measurements say nothing about forces that do not move it.
    known = std < 0.5 * np.sqrt(np.mean(signal**2 + std**2))
    known &= ~_pushed(model, x, u)[:, None]
    if np.count_nonzero(known) < _LEAST_KNOWN:
        known[:] = True
    pairs = [tuple(ports), *_pairs(model, ports)]
    names = [port.name for port in model.ports]
    trace = model.exact
    places = [names.index(port) for port in dict.fromkeys(port for pair in pairs for port in pair)]
    if not model.ports[places[0]].signals:
        raise WorkbenchError(
            f"port {ports[0]!r} of {model.name!r} has no local signals that a law could depend on;"
            " choose a port that has"
        )
    columns = [index_of("parameter", prior.name, model.parameters) for prior in priors]
    free = trace.p[columns] if columns else ca.SX(0, 1)
    by_port, by_free, values, *local = trace.along(
        x,
        u,
        model.values,
        trace.rates_by_port,
        ca.jacobian(trace.rates, free),
        trace.signals,
        *(trace.local_signals[i] for i in places),
    )
    scale = np.array([q.scale for q in model.states])[:, None]
    there = by_port[:, :, [names.index(port) for port in ports]] / scale
    inverse = np.linalg.pinv(there)
    of_port = {names[i]: seen for i, seen in zip(places, local, strict=True)}
    sites: list[Site] = []
    for pair in pairs:
        effect = inverse @ (by_port[:, :, [names.index(port) for port in pair]] / scale)
        site = _site(model, pair, effect, of_port, x, u, values[:, :, 0])
        same = next((i for i, other in enumerate(sites) if _alike(other, site)), None)
        if same is None:
            sites.append(site)
        elif same > 0 and np.min(sites[same].value) < 0.0 <= np.min(site.value):
            # Of two ports in a row that see the same, the one whose signal keeps its sign allows
            # a law that is a fraction of it.
            sites[same] = site
    deviation = np.array([prior.std for prior in priors])
    nominal = np.einsum("nlx,nxf->lnf", inverse, by_free / scale * deviation)
    return Evidence(
        tuple(ports),
        signal.T.ravel(),
        known.T.ravel(),
        nominal.reshape(-1, len(columns)),
        (np.array([prior.mean for prior in priors]) - model.values[columns]) / deviation,
        tuple(sites),
        time,
        np.concatenate([np.full(len(part.time[::every]), i) for i, part in enumerate(parts)]),
    )


def _pairs(model: Model, ports: Sequence[str]) -> list[tuple[str, ...]]:
    """Pairs of ports, numbered 1 and 2, that act on the rates as a located port does."""
    names = [port.name for port in model.ports]
    twins = [(name, name.replace("_1.", "_2.")) for name in names if "_1." in name]
    directions = directions_of(model, model.initial_state(), model.nominal_input)
    own = directions[:, [names.index(port) for port in ports]]
    return [
        pair
        for pair in twins
        if pair[1] in names
        and pair[0] not in ports
        and all(np.max(np.abs(directions[:, names.index(port)] @ own)) > PARALLEL for port in pair)
    ]


def _pushed(model: Model, x: Vector, u: Vector) -> npt.NDArray[np.bool_]:
    """Where a port acts whose signal is only known in proportion, such as a stop in contact."""
    names = [q.name for q in model.ports if q.relative_disturbance > 0]
    if not names:
        return np.zeros(len(x), dtype=bool)
    trace = model.exact
    rows = [trace.signal_names.index(name) for name in names]
    pushes = trace.along(x, u, model.values, trace.signals[rows])[0][:, :, 0]
    scale = np.array([q.scale for q in model.ports if q.name in names])
    return np.asarray(np.any(np.abs(pushes) > 1e-3 * scale, axis=1))


def _alike(one: Site, other: Site) -> bool:
    return one.signals.keys() == other.signals.keys() and all(
        np.array_equal(values, other.signals[name]) for name, values in one.signals.items()
    )


def _site(
    model: Model,
    ports: tuple[str, ...],
    effect: Vector,
    of_port: dict[str, Vector],
    states: Vector,
    inputs: Vector,
    values: Vector,
) -> Site:
    """Local signals that vary and are not the same as another one."""
    names = model.exact.signal_names
    known = [
        *((states[:, i], q.unit) for i, q in enumerate(model.states)),
        *((inputs[:, i], q.unit) for i, q in enumerate(model.inputs)),
        *((values[:, i], unit) for i, unit in enumerate(model.exact.signal_units)),
    ]
    signals: dict[str, Vector] = {}
    units: dict[str, str] = {}
    port = next(q for q in model.ports if q.name == ports[0])
    for i, name in enumerate(port.signals):
        column = np.column_stack([of_port[at][:, i, 0] for at in ports])
        if float(np.std(column)) <= 1e-9 * float(np.abs(column).max()):
            continue
        alike = (np.corrcoef(column.ravel(), v.ravel())[0, 1] for v in signals.values())
        if any(abs(float(r)) > _SAME for r in alike):
            continue
        signals[name] = column
        units[name] = _unit(name, column[:, 0], known, units)
    value = values[:, [names.index(at) for at in ports]]
    return Site(ports, port.unit, signals, units, value, effect)


def _unit(
    name: str, column: Vector, known: Sequence[tuple[Vector, str]], units: dict[str, str]
) -> str:
    """Return the unit of what a local signal equals but for a constant."""
    moving = column - column.mean()
    for other, unit in known:
        if np.allclose(moving, other - other.mean(), rtol=0, atol=1e-6 * float(np.std(column))):
            return unit
    of = name.removesuffix("_speed")
    return f"{units[of]}/s" if of in units and of != name else "1"
