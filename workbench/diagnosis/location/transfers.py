"""How a small signal at each port of a model moves the measurements, at operating points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from workbench.arrays import Complex, Vector
from workbench.diagnosis.location.structure import Cut
from workbench.linearisation.transfer import transfer_function
from workbench.recordings.checks.expected import middle_speed

FREQUENCIES = (0.01, 0.1, 1.0, 10.0)
"""Frequencies at which transfers are computed, as multiples of the pace of the model."""

_POINTS = 5
_REACH = 0.4


@dataclass(frozen=True)
class Transfers:
    """Transfers from the ports to the measurements.

    Args:
        measurements: From each port at its scale to each recorded output over its noise, shape
            (n, n_outputs, n_p): n pairs of an operating point and a frequency.
        signals: The same to each further signal that could be read, not scaled, shape (n, n_p), by
            name.
    """

    ports: tuple[str, ...]
    measurements: Complex
    signals: Mapping[str, Complex]

    def rows(self, ports: Sequence[str]) -> list[int]:
        """Return the places of some ports."""
        return [self.ports.index(port) for port in ports]

    def sines(self, sensor: str | None = None) -> Vector:
        """Return how far the directions in which two ports move the measurements are apart.

        Args:
            sensor: Name of a further signal that is read; none by default.

        Returns:
            Largest sine of the angle between the directions, shape (n_p, n_p), dimensionless; NaN
            where one of the ports moves no measurement, like a stop that is not touched.
        """
        g = self.measurements
        if sensor is not None:
            row = self.signals[sensor]
            size = np.abs(row).max(initial=0.0)
            # As strong as the other measurements: only its direction matters here.
            strength = np.abs(g).max(initial=0.0) or 1.0
            g = np.concatenate([g, row[:, None, :] * (strength / size if size else 0.0)], axis=1)
        size = np.linalg.norm(g, axis=1)[:, None, :]
        least = 1e-15 * size.max(initial=0.0)
        unit = np.divide(g, size, out=np.full_like(g, np.nan), where=size > least)
        # The part across the other's direction: 1 - cos^2 would lose half of the digits.
        cosines = np.einsum("nki,nkj->nij", unit.conj(), unit)
        across = unit[:, :, None, :] - unit[:, :, :, None] * cosines[:, None, :, :]
        return np.asarray(np.fmax.reduce(np.linalg.norm(across, axis=1), axis=0, initial=np.nan))


def transfers(parts: Cut, outputs: Sequence[str]) -> Transfers:
    """Linearise a model about operating points near its start, always the same ones.

    Returns:
        ``G = C (jw - A)^-1 B + D`` from the ports.
    """
    model, traced = parts.model, parts.model.exact
    chosen = [[q.name for q in model.outputs].index(o) for o in outputs]
    used = [model.outputs[i] for i in chosen]
    noise = np.array([np.hypot(q.noise_rms, q.resolution) or 1e-4 * q.scale for q in used])
    scale = np.array([q.scale for q in model.ports])
    states = {q.name: i for i, q in enumerate(model.states)}
    further = [n for n in parts.signals if n not in states]
    whole = ca.Function(
        "whole",
        [traced.x, traced.u, traced.p],
        [
            ca.densify(part)
            for part in (
                ca.jacobian(traced.rates, traced.x),
                traced.rates_by_port,
                ca.jacobian(traced.outputs[chosen], traced.x),
                traced.outputs_by_port[chosen, :],
            )
        ],
    )
    between = _between(parts, further)
    # A model of integrators alone has no pace.
    pace = np.nan_to_num(middle_speed(model.without(*model.dry_effects)), nan=1.0)
    measurements: list[Complex] = []
    signals: dict[str, list[Complex]] = {n: [] for n in (*states, *further)}
    for x, u in _points(parts):
        a, b, c, d = (np.asarray(part, dtype=float) for part in whole(x, u, model.values))
        made, read = (np.asarray(p, dtype=float) for p in between(x, u, model.values))
        if not all(np.isfinite(part).all() for part in (a, b, c, d, made, read)):
            continue
        n_x = len(x)
        # What leaves the ports: what entered, of states and other ports, and what is added.
        through = np.linalg.inv(np.eye(len(made)) - made[:, n_x:])
        for frequency in pace * np.array(FREQUENCIES):
            moved = transfer_function(a, b, np.eye(n_x), np.zeros_like(b), 1j * frequency)
            left = through @ (made[:, :n_x] @ moved + np.eye(len(made)))
            measurements.append((c @ moved + d) * scale / noise[:, None])
            rows = read[:, :n_x] @ moved + read[:, n_x:] @ left
            for name, row in zip((*states, *further), (*moved, *rows), strict=True):
                signals[name].append(row * scale)
    empty = np.zeros((0, len(chosen), len(scale)), dtype=np.complex128)
    return Transfers(
        tuple(q.name for q in model.ports),
        np.stack(measurements) if measurements else empty,
        {n: np.stack(rows) if rows else empty[:, 0] for n, rows in signals.items()},
    )


def _between(parts: Cut, names: Sequence[str]) -> ca.Function:
    """Build the slopes of what enters the ports and of signals, by states and by ports."""
    model = parts.model
    arguments = [parts.states, parts.inputs, parts.parameters]
    read = ca.vertcat(ca.SX(0, 1), *(parts.signals[n] for n in names))
    slopes = [ca.jacobian(e, parts.unknowns) for e in (parts.entering, read)]
    values = _port_values(parts)
    slopes = [ca.densify(ca.substitute(s, parts.symbols, values)) for s in slopes]
    assert len(model.ports) == parts.symbols.numel()
    return ca.Function("between", arguments, slopes, {"cse": True})


def _port_values(parts: Cut) -> ca.SX:
    """Return what leaves each port where nothing is missing, in states, inputs, parameters."""
    known: list[ca.SX] = []
    for i in range(parts.symbols.numel()):
        # A port holds only ports that were opened before it.
        before = ca.vertcat(ca.SX(0, 1), *known)
        known.append(ca.substitute(parts.entering[i], parts.symbols[:i, 0], before))
    return ca.vertcat(ca.SX(0, 1), *known)


def _points(parts: Cut) -> list[tuple[Vector, Vector]]:
    rng = np.random.default_rng(0)
    model = parts.model
    points = []
    start, rest = model.initial_state(), model.nominal_input
    for _ in range(_POINTS):
        x = start + rng.uniform(-_REACH, _REACH, len(start)) * [q.scale for q in model.states]
        u = rest + rng.uniform(-_REACH, _REACH, len(rest)) * [q.scale for q in model.inputs]
        x = np.clip(x, [q.lower for q in model.states], [q.upper for q in model.states])
        u = np.clip(u, [q.lower for q in model.inputs], [q.upper for q in model.inputs])
        points.append((x, u))
    return points
