"""The result of fitting a law without a name: curves with their evidence and their judgement."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.nonparametric.curve_description import Term
from workbench.errors import check_choice
from workbench.model import Effect
from workbench.model.quantities import declared_unit
from workbench.physics.nonparametric_term import Curve, nonparametric_term

EFFECT_NAME = "nonparametric"
"""Name of the effect in the extended model."""


@dataclass(frozen=True)
class Bins:
    """The located signal over an argument, less what the parameters and other curves take.

    Args:
        x: Mean of the argument in each class, shape (n,), in its unit.
        mean: Mean of the signal, shape (n,), in the unit of the curve.
        std: Its standard deviation within the class, shape (n,), in that unit.
        curve: Mean of the fitted curve in the class, shape (n,), in that unit.
    """

    x: Vector
    mean: Vector
    std: Vector
    curve: Vector


@dataclass(frozen=True)
class Argument:
    """An argument of a nonparametric term.

    Args:
        p_value: Probability of as strong a dependence by chance, dimensionless.
        share: Share of the signal that it predicts across blocks of time beyond the arguments
            before it, dimensionless.
        hull: Smallest and largest value in the fitting recordings, in ``unit``.
        bins: The signal over it; None if nothing was fitted.
    """

    name: str
    unit: str
    p_value: float
    share: float
    hull: tuple[float, float]
    bins: Bins | None = None
    terms: tuple[Term, ...] = ()


@dataclass(frozen=True)
class Likeness:
    """A shape of the library in the place of a curve, refitted in the equations.

    Args:
        law: Law of the library that has the shape; empty for the curve itself.
        values: ``size``, ``level`` and further parameters of the shape, in SI.
        gain: Gain of log likelihood on the fitting recordings, dimensionless.
        penalised: The same less the penalty for the parameters, dimensionless.
    """

    law: str
    values: Mapping[str, float]
    gain: float
    penalised: float


@dataclass(frozen=True)
class Law:
    """What the term adds to the equations, without its ordinates.

    Args:
        typical: Usual ordinate, in the unit of the curves.
        upper: Largest ordinate, in the unit of the curves.
        loop: Rate, unit and distance of the memory; None if there is none.
    """

    ports: tuple[str, ...]
    curves: tuple[Curve, ...]
    unit: str
    relative: bool
    typical: float
    upper: float
    loop: tuple[str, str, float] | None = None

    @property
    def effect(self) -> Effect:
        """The effect, with ordinates of zero."""
        return nonparametric_term(
            self.ports,
            self.curves,
            unit=self.unit,
            relative=self.relative,
            typical=self.typical,
            upper=self.upper,
            loop=self.loop,
            name=EFFECT_NAME,
        )


@dataclass(frozen=True)
class NonparametricTerm:
    """A law without a name, fitted and judged.

    Args:
        fit: The refit with the term; that without it if nothing was fitted.
        unit: Unit of the curves: that of the ports, or ``"1"`` if they are a fraction of it.
        explained: Share of the mean square of the smoothed signal that curves and changed
            parameters take away, dimensionless.
        gain: Gain of log likelihood on the fitting recordings, dimensionless.
        held_out: Gain on the held-out recordings with its 99 % interval, dimensionless.
        rmse: Free-run error on the held-out recordings by output, without and with the term, in
            SI.
        law: What the term adds to the equations; None if nothing was fitted.
        likenesses: What the curve resembles, the likeliest first, with the curve itself; empty
            where it was not compared.
    """

    fit: ProcessNoiseFit
    ports: tuple[str, ...]
    unit: str = "1"
    relative: bool = False
    curves: Mapping[str, Curve] = field(default_factory=dict)
    arguments: tuple[Argument, ...] = ()
    loop: bool = False
    explained: float = math.nan
    gain: float = 0.0
    held_out: tuple[float, float, float] = (0.0, -math.inf, math.inf)
    rmse: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    reason: str = ""
    law: Law | None = None
    likenesses: tuple[Likeness, ...] = ()

    @property
    def likeness(self) -> Likeness | None:
        """The shape of the library that is likelier than the curve; None if there is none."""
        first = self.likenesses[0] if self.likenesses else None
        return first if first is not None and first.law else None

    @property
    def accepted(self) -> bool:
        """Whether the term passed every rule."""
        return not self.reason

    @property
    def effect_name(self) -> str:
        """Name of the effect in the extended model."""
        return EFFECT_NAME

    def read_in(self, argument: str = "") -> str:
        """Return the unit declared for reading an argument, or the curves; empty if none."""
        model, place = self.fit.model, next(q for q in self.fit.model.ports if q.name in self.ports)
        if not argument:
            return model.read_at([place.name], self.unit)
        origins = dict(zip(place.signals, place.origins, strict=False))
        unit = next(a.unit for a in self.arguments if a.name == argument)
        return declared_unit(origins.get(argument, argument), unit, model.quantities)

    def curve(self, x: npt.ArrayLike, argument: str | None = None) -> Vector:
        """Compute the fitted curve, shape (n,), in ``unit``.

        Args:
            x: Values of the argument, shape (n,), in its SI unit.
            argument: Name of the argument; the first by default.
        """
        name = argument or next(iter(self.curves), "")
        check_choice("argument of the nonparametric term", name, list(self.curves))
        curve = self.curves[name]
        values = [self.fit.refit.estimate(f"{EFFECT_NAME}.{short}").value for short in curve.names]
        return np.asarray(curve.functions(np.asarray(x, dtype=float)) @ np.array(values))

    def __str__(self) -> str:
        form = "fraction of the signal at" if self.relative else "added at"
        lines = [f"nonparametric term {form} {', '.join(self.ports)}: {self.reason or 'accepted'}"]
        for a in self.arguments:
            lines.append(
                f"  over {a.name:<20} p {a.p_value:<6.2g} share {a.share:>6.2f}"
                f"  from {a.hull[0]:.4g} to {a.hull[1]:.4g} {a.unit}"
            )
            if a.terms:
                lines.append(f"    like {', '.join(map(str, a.terms))}")
        if self.loop:
            loop = self.fit.refit.estimate(f"{EFFECT_NAME}.loop")
            lines.append(f"  loop {loop.value:.3g} +- {loop.std:.2g} {loop.unit}")
        if self.rmse:
            gain, low, high = self.held_out
            lines += [
                f"  share of the located signal  {self.explained:.2f}",
                f"  gain of log likelihood       {self.gain:.0f}",
                f"  on held-out recordings       {gain:.0f} [{low:.0f}, {high:.0f}]",
            ]
            lines += [
                f"  free run, {name:<18} {before:.4g} -> {after:.4g}"
                for name, (before, after) in self.rmse.items()
            ]
        return "\n".join(lines)
