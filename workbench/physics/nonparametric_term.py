"""A law without a name: a smooth curve over what a port sees, with its ordinates as parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError, check_finite
from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.regularisation import Expression, is_symbolic, maximum, minimum

BEYOND = 0.1
"""Share of the distance between the outer knots over which a curve goes on as a straight line;
further out it is constant."""


@dataclass(frozen=True)
class Curve:
    """The natural cubic spline over one argument, as a sum of one function per knot.

    ``y = sum_j c_j [phi_j(x) - mean_j]`` with ``phi_j = 1`` at knot j and 0 at the others. With the
    means of phi_j over some data as ``mean_j`` the curve is zero on average over those data.

    Args:
        knots: Abscissae, shape (n,), at least 3, increasing, in ``unit``.
        mean: What is taken off each function, shape (n,), dimensionless; nothing by default.

    Example:
        >>> line = Curve("speed", "m/s", (-1.0, 0.0, 2.0))
        >>> np.round(line.functions(np.array([-1.0, 0.0])), 12).tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        >>> float(np.round(line.functions(np.array([1.0])) @ [-3.0, 0.0, 6.0], 12)[0])
        3.0
    """

    argument: str
    unit: str
    knots: tuple[float, ...]
    mean: tuple[float, ...] = field(default=())

    def __post_init__(self) -> None:
        knots = [check_finite(f"knot over {self.argument}", knot) for knot in self.knots]
        if len(knots) < 3 or min(np.diff(knots)) <= 0:
            raise WorkbenchError(
                f"knots over {self.argument} are {knots}; a curve needs at least 3, increasing"
            )
        if self.mean and len(self.mean) != len(knots):
            raise WorkbenchError(
                f"a curve over {self.argument} has {len(knots)} knots and {len(self.mean)} means;"
                " give one mean per knot, or none"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Short names of the ordinates as parameters of an effect."""
        return tuple(f"{self.argument}_{i + 1}" for i in range(len(self.knots)))

    @cached_property
    def _weights(self) -> Vector:
        """What 1, t and max(0, t - t_i)^3 have to be multiplied by, shape (n + 2, n)."""
        t = self._scaled
        n = len(t)
        system = np.zeros((n + 2, n + 2))
        system[:n] = np.column_stack([np.ones(n), t, np.maximum(t[:, None] - t[None, :], 0.0) ** 3])
        # Straight beyond the last knot: the cubes and squares cancel there.
        system[n, 2:], system[n + 1, 2:] = 1.0, t
        return np.asarray(np.linalg.solve(system, np.eye(n + 2, n)))

    @property
    def _scaled(self) -> Vector:
        knots = np.array(self.knots)
        return np.asarray((knots - knots[0]) / (knots[-1] - knots[0]))

    def functions(self, x: npt.ArrayLike) -> Vector:
        """Compute the function of every knot less its mean, shape (m, n), dimensionless.

        Args:
            x: Argument, shape (m,), in the curve's unit.
        """
        parts = self._parts(np.asarray(x, dtype=float))
        mean = np.array(self.mean) if self.mean else 0.0
        return np.asarray(np.stack(parts, axis=-1) @ self._weights - mean)

    def value(self, x: Expression, ordinates: Sequence[Expression]) -> Expression:
        """Compute the curve, in the unit of the ordinates.

        Args:
            x: Argument, in the curve's unit.
            ordinates: Ordinates at the knots, shape (n,), in any unit.
        """
        total: Expression = 0.0
        for part, row in zip(self._parts(x), self._weights, strict=True):
            total = total + part * sum(w * c for w, c in zip(row, ordinates, strict=True))
        for mean, ordinate in zip(self.mean, ordinates, strict=False):
            total = total - mean * ordinate
        return total

    def _parts(self, x: Expression) -> list[Expression]:
        first, last = self.knots[0], self.knots[-1]
        t = (x - first) / (last - first)
        t = minimum(maximum(t, -BEYOND), 1.0 + BEYOND)
        one = ca.SX(1.0) if is_symbolic(t) else np.ones_like(t)
        return [one, t, *(maximum(t - knot, 0.0) ** 3 for knot in self._scaled)]


def nonparametric_term(
    port: str | tuple[str, ...],
    curves: tuple[Curve, ...],
    *,
    unit: str,
    relative: bool = False,
    ordinates: Mapping[str, float] | None = None,
    upper: float = 100.0,
    typical: float = 1.0,
    loop: tuple[str, str, float] | None = None,
    name: str = "nonparametric",
) -> Effect:
    """Build a law that is nothing but one or two curves, and a loop if it has a memory.

    ``y = y + sum_k f_k(x_k) + loop z``, or ``y = y [1 + sum_k f_k(x_k) + loop z]`` if relative,
    with ``dz/dt = (v - |v| z) / distance`` and v the rate of the loop's coordinate (Dahl 1968): z
    tends to the sign of the rate over ``distance``, so that the loop is the same at any speed.

    Args:
        curves: The curves, over different local signals of every port.
        relative: Whether the curves are a fraction of the port's signal.
        ordinates: Ordinates by short name, ``"speed_1"`` for the first knot over ``speed``, and the
            half height ``"loop"``, in ``unit`` (dimensionless if relative); 0 where none is given.
        upper: Largest plausible magnitude of an ordinate, in ``unit`` (dimensionless if relative).
        typical: Usual magnitude, in the same unit; scales the fit.
        loop: Name of the local signal whose value is the rate of the loop's coordinate, the unit
            of that coordinate, and the distance over which the loop is closed, in that unit; no
            loop by default.

    Returns:
        Effect with one parameter per knot, all zero unless given: absent.
    """
    arguments = [curve.argument for curve in curves]
    if len(set(arguments)) != len(arguments):
        raise WorkbenchError(
            f"effect {name!r} has two curves over {', '.join(arguments)}; give each its own"
            " argument"
        )
    ports = (port,) if isinstance(port, str) else port
    own_unit = "1" if relative else unit

    def transform(at: PortView) -> Expression:
        added: Expression = 0.0
        for curve in curves:
            own = [at.p[short] for short in curve.names]
            added = added + curve.value(at.signals[curve.argument], own)
        if loop is not None:
            added = added + at.p.loop * at.x[f"memory_{at.index + 1}"]
        return at.value * (1.0 + added) if relative else at.value + added

    def rates(view: EffectView) -> Mapping[str, Expression]:
        assert loop is not None
        result: dict[str, Expression] = {}
        for i, at in enumerate(view.at[p] for p in ports):
            v, z = at.signals[loop[0]], at.x[f"memory_{i + 1}"]
            result[f"memory_{i + 1}"] = (v - maximum(v, -v) * z) / view.p.distance
        return result

    def ordinate(short: str, text: str) -> Parameter:
        return Parameter(short, own_unit, typical, text, 0.0, -upper, upper, fitted=True)

    parameters = [
        ordinate(short, f"ordinate at {curve.argument.replace('_', ' ')} {knot:.4g} {curve.unit}")
        for curve in curves
        for short, knot in zip(curve.names, curve.knots, strict=True)
    ]
    if loop is not None:
        _, way, usual = loop
        text = "distance over which the loop is closed"
        ends = 0.1 * usual, 10.0 * usual
        parameters += [
            ordinate("loop", "half height of the loop"),
            Parameter("distance", way, usual, text, usual, *ends, fitted=True),
        ]
    sums = " + ".join(f"f({a})" for a in (*arguments, *(["history"] if loop else [])))
    return Effect(
        name,
        ports,
        transform,
        parameters=tuple(parameters),
        states=tuple(
            State(f"memory_{i + 1}", "1", 1.0, "where the loop is, -1 to 1", start_rms=0.5)
            for i in range(len(ports) if loop else 0)
        ),
        rates=rates if loop else None,
        about=About(
            f"y [1 + {sums}]" if relative else f"y + {sums}",
            "curves estimated from recordings; valid where those have data",
        ),
    ).with_parameters(dict(ordinates or {}))
