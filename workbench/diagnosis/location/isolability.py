"""What could be located at all: which ports the sensors can tell apart, before any recording.

Two routes, and only what both tell apart counts: the structure of the equations, and the directions
in which a signal at each port moves the measurements. Ports whose directions are the same at every
frequency and operating point cannot be told apart by any recording.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from workbench.arrays import Complex, Vector
from workbench.diagnosis.location.structure import Cut, Structure, cut, structure_of
from workbench.errors import check_choice
from workbench.linearisation.transfer import transfer_function
from workbench.model import Input, Model, State
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
    rng, model = np.random.default_rng(0), parts.model
    start, rest = model.initial_state(), model.nominal_input

    def near(values: Vector, own: Sequence[State | Input]) -> Vector:
        moved = values + rng.uniform(-_REACH, _REACH, len(values)) * [q.scale for q in own]
        return np.clip(moved, [q.lower for q in own], [q.upper for q in own])

    return [(near(start, model.states), near(rest, model.inputs)) for _ in range(_POINTS)]


Groups = tuple[tuple[str, ...], ...]

_SAME = 1e-6
"""Sine of the angle between two directions below which they are one."""


@dataclass(frozen=True)
class Sensor:
    """A sensor to add, and what it would split.

    Args:
        signal: Name of the port, signal or state to read.
        before: Whether to read what enters the port rather than what leaves it, so on the other
            side of what may be missing there.
        splits: For each group that it would split, the parts.
    """

    signal: str
    before: bool
    splits: tuple[Groups, ...]

    @property
    def gained(self) -> int:
        """How many more groups there would be."""
        return sum(len(parts) - 1 for parts in self.splits)

    @property
    def text(self) -> str:
        """What to read, in words."""
        return f"{self.signal} (as it enters)" if self.before else self.signal

    def __str__(self) -> str:
        splits = "; ".join(" | ".join(", ".join(part) for part in parts) for parts in self.splits)
        return f"{self.text} splits {splits}"


@dataclass(frozen=True)
class Isolability:
    """Which ports the sensors can tell apart.

    Args:
        groups: Ports that cannot be told apart, group by group.
        unseen: Ports at which nothing that is missing could be seen.
        nearest: For each group, by its first port: the first port of the group that is hardest to
            tell from it, and the largest angle between the directions of their measurements, in
            rad.
        readable: Unknowns in each signal that could be read.
    """

    model: str
    outputs: tuple[str, ...]
    groups: Groups
    unseen: tuple[str, ...]
    nearest: Mapping[str, tuple[str, float]]
    structure: Structure = field(repr=False)
    readable: Mapping[str, tuple[str, ...]] = field(repr=False)
    transfers: Transfers = field(repr=False)

    def group_of(self, port: str) -> tuple[str, ...]:
        """Return the ports that cannot be told from one; itself alone if nothing is seen there."""
        check_choice("port", port, [*(p for g in self.groups for p in g), *self.unseen])
        return next((g for g in self.groups if port in g), (port,))

    def sensors_that_split(self, group: Sequence[str] | None = None) -> tuple[Sensor, ...]:
        """Return sensors that would split the group of some ports, or any, the best first.

        Of several that split the same, it is the first in the order of the equations.
        """
        wanted = self.groups if group is None else (self.group_of(next(iter(group))),)
        found: dict[tuple[Groups, ...], Sensor] = {}
        for name, holds in self.readable.items():
            sines = self.transfers.sines(name)
            finer = _joined(
                self.structure.with_measurement(holds).groups()[0], self.transfers, sines
            )
            splits = []
            for old in wanted:
                parts = tuple(p for f in finer if (p := tuple(n for n in old if n in f)))
                if len(parts) > 1:
                    splits.append(parts)
            key = tuple(splits)
            if splits and key not in found:
                signal = name.removesuffix(" before")
                found[key] = Sensor(signal, name != signal, key)
        return tuple(sorted(found.values(), key=lambda s: -s.gained))

    def __str__(self) -> str:
        width = 60
        lines = [
            f"{self.model} with {', '.join(self.outputs)}: groups of ports that can be told apart",
            f"  {'ports of a group':<{width}}  hardest to tell from",
        ]
        for group in self.groups:
            near = self.nearest.get(group[0])
            beside = "" if near is None else f"{near[0]} ({np.degrees(near[1]):.2g} deg)"
            for i, part in enumerate(textwrap.wrap(", ".join(group), width)):
                lines.append(f"  {part:<{width}}  {beside if i == 0 else ''}".rstrip())
        if self.unseen:
            lines.append("  cannot be seen")
            lines += [f"  {part}" for part in textwrap.wrap(", ".join(self.unseen), width)]
        return "\n".join(lines)


def isolability(model: Model, *, outputs: Sequence[str] | None = None) -> Isolability:
    """Find out which ports the sensors could tell apart, from the equations alone.

    A port is told from another if its equation can still be checked against the measurements when
    the equation of the other is not used (Krysander and Frisk 2008). Structure alone may promise
    too much, so ports are joined whose signals move the measurements in the same direction,
    ``G_i(jw) = a(jw) G_j(jw)`` with the linearised transfers from ports to measurements, at every
    one of several operating points and frequencies.

    Raises:
        WorkbenchError: If there is no such output.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> print(isolability(servo_axis()))
        servo axis with position: groups of ports that can be told apart
          ports of a group                                              hardest to tell from
          axis.force, position.reading
    """
    read = tuple(q.name for q in model.outputs) if outputs is None else tuple(outputs)
    parts = cut(model)
    structure, readable = structure_of(parts, read)
    moved = transfers(parts, read)
    sines = moved.sines()
    groups, unseen = structure.groups()
    groups = _joined(groups, moved, sines)
    nearest = {}
    for group in groups:
        angles = {
            other[0]: float(np.nanmax(near))
            for other in groups
            if other is not group
            and np.isfinite(near := sines[np.ix_(moved.rows(group), moved.rows(other))]).any()
        }
        if angles:
            hardest = min(angles, key=angles.__getitem__)
            nearest[group[0]] = hardest, float(np.arcsin(min(angles[hardest], 1.0)))
    return Isolability(model.name, read, groups, unseen, nearest, structure, readable, moved)


def _joined(groups: Groups, moved: Transfers, sines: Vector) -> Groups:
    """Join groups in which two ports move the measurements in the same direction."""
    joined: list[tuple[str, ...]] = []
    alike = np.nan_to_num(sines, nan=1.0) < _SAME
    for group in groups:
        same = [g for g in joined if alike[np.ix_(moved.rows(group), moved.rows(g))].any()]
        joined = [g for g in joined if g not in same]
        together = {*group, *(p for g in same for p in g)}
        joined.append(tuple(p for p in moved.ports if p in together))
    return tuple(sorted(joined, key=lambda g: moved.ports.index(g[0])))
