"""Shapes of the library's laws, matched against a fitted curve by their own likelihood.

A curve over one argument is compared with the functions that the laws of the library are made of,
whatever the argument is: each is fitted to the curve, those that come nearest are put into the
equations in its place and refitted by prediction error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import CodeType, SimpleNamespace

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    extended_start,
    fit_with_process_noise,
)
from workbench.diagnosis.nonparametric.result import Argument, Likeness, NonparametricTerm
from workbench.errors import NumericalError
from workbench.model import Effect, Parameter, PortView
from workbench.model.regularisation import Expression
from workbench.model.units import per

EFFECT_NAME = "shape"
"""Name of the effect while a shape is refitted."""

_REFITTED = 3
_ROOM = 20.0
_EXACT = 1e-3


@dataclass(frozen=True)
class Shape:
    """A function of one argument that laws of the library are made of.

    The law adds ``size (g(x) - level)``; at size zero it is absent.

    Args:
        formula: g as Python, with the argument x and the parameters ``at.p``.
        power: Power of the argument by which the unit of the size is divided.
        inner: Names of the further parameters: ``width`` and ``centre`` in the argument's unit,
            ``frequency`` in its inverse, ``phase`` without one.
        turns: Whether it is something of its own only where the argument has both signs.
    """

    name: str
    formula: str
    power: int = 0
    inner: tuple[str, ...] = ()
    turns: bool = False

    def function(self, x: Expression, p: Mapping[str, Expression]) -> Expression:
        """Return g of an argument, with the further parameters by name; all in SI."""
        at = SimpleNamespace(p=SimpleNamespace(**p))
        g: Expression = eval(self._code, {"ca": ca}, {"x": x, "at": at})  # noqa: S307
        return g

    @cached_property
    def _code(self) -> CodeType:
        return compile(self.formula, self.name, "eval")

    def unit(self, own: str, argument: str) -> str:
        """Return the unit of the size from those of the curve and of the argument."""
        return per(own, argument, self.power) if self.power else own

    def units(self, argument: str) -> dict[str, str]:
        """Return the units of the further parameters."""
        units = {"width": argument, "centre": argument, "frequency": per("1", argument)}
        return {name: units.get(name, "1") for name in self.inner}

    def starts(self, low: float, high: float) -> list[dict[str, float]]:
        """Return values, in SI, of the further parameters to fit from, for an argument's range."""
        span, middle = high - low, 0.5 * (low + high)
        near = min(max(0.0, low), high)
        if "frequency" in self.inner:
            return [{"frequency": 2 * math.pi * k / span, "phase": 0.0} for k in (1.5, 3, 6, 12)]
        if "centre" in self.inner:
            return [{"centre": c, "width": w * span} for c in (middle, near) for w in (0.1, 0.3)]
        if "width" in self.inner:
            return [{"width": w * span} for w in (0.02, 0.1, 0.3)]
        return [{}]

    def bounds(self, low: float, high: float) -> dict[str, tuple[float, float]]:
        """Return between which values, in SI, the further parameters are sought.

        A width beyond the data, or a wave that does not complete a period, is another shape.
        ``low`` and ``high`` are the ends of the argument, in its SI unit.
        """
        span = high - low
        ends = {
            "width": (1e-3 * span, span),
            "centre": (low, high),
            "frequency": (2 * math.pi / span, 200.0 / span),
            "phase": (-7.0, 7.0),
        }
        return {name: ends[name] for name in self.inner}


SHAPES: tuple[Shape, ...] = (
    Shape("linear_spring", "x", 1),
    Shape("quadratic_drag", "x * ca.fabs(x)", 2, turns=True),
    Shape("polynomial_stiffness", "x * x", 2),
    Shape("cubic_stiffness", "x * x * x", 3),
    Shape("direction_dependent_viscous", "ca.fabs(x)", 1, turns=True),
    Shape("coulomb_friction", "ca.tanh(x / at.p.width)", inner=("width",), turns=True),
    Shape(
        "stribeck_friction",
        "ca.tanh(20 * x / at.p.width) * ca.exp(-((x / at.p.width) ** 2))",
        inner=("width",),
        turns=True,
    ),
    Shape("saturation", "ca.tanh((x - at.p.centre) / at.p.width)", inner=("centre", "width")),
    Shape(
        "local_catch", "ca.exp(-(((x - at.p.centre) / at.p.width) ** 2))", inner=("centre", "width")
    ),
    Shape("ripple", "ca.sin(at.p.frequency * x + at.p.phase)", inner=("frequency", "phase")),
)
"""What a curve is compared with, by the law of the library that it is known from."""


def matched(
    term: NonparametricTerm,
    base: ProcessNoiseFit,
    fit_on: Sequence[Observed],
    priors: Sequence[Prior],
    *,
    penalty: float,
) -> NonparametricTerm:
    """Compare the curve of an accepted term with the shapes of the library.

    Args:
        base: The refitted model without it, for which recordings and priors are.
        penalty: What a parameter has to gain, in units of log likelihood.

    Returns:
        The term with what its curve resembles, the likeliest first; unchanged if it has two
        arguments or a memory.
    """
    if len(term.arguments) != 1 or term.loop:
        return term
    argument = term.arguments[0]
    low, high = argument.hull
    both = low < -0.1 * (high - low) and high > 0.1 * (high - low)
    offered = [shape for shape in SHAPES if both or not shape.turns]
    near = sorted(
        ((*_nearest(shape, term, argument), shape) for shape in offered), key=lambda n: n[0]
    )
    likenesses = []
    for _, values, shape in near[:_REFITTED]:
        effect = shape_effect(shape, term, argument, values)
        try:
            fit = _refitted(effect, base, fit_on, priors)
        except NumericalError:
            continue
        own = {
            q.name: fit.refit.estimate(f"{EFFECT_NAME}.{q.name}").value for q in effect.parameters
        }
        gain = base.cost - fit.cost
        likenesses.append(Likeness(shape.name, own, gain, gain - penalty * len(own)))
    curves = len(term.fit.refit.estimates) - len(base.refit.estimates)
    likenesses.append(Likeness("", {}, term.gain, term.gain - penalty * curves))
    return replace(term, likenesses=tuple(sorted(likenesses, key=lambda k: -k.penalised)))


def _nearest(
    shape: Shape, term: NonparametricTerm, argument: Argument
) -> tuple[float, dict[str, float]]:
    """Fit a shape to the curve where it was measured; returns what is left and the values."""
    from scipy.optimize import least_squares

    low, high = argument.hull
    x = np.linspace(low, high, 60) if argument.bins is None else argument.bins.x
    y = term.curve(x, argument.name)
    size = float(np.std(y)) or 1.0

    def linear(inner: Vector) -> tuple[Vector, Vector]:
        p = dict(zip(shape.inner, inner.tolist(), strict=True))
        g = np.array([float(shape.function(value, p)) for value in x.tolist()])
        unit = float(np.abs(g).max()) or 1.0
        columns = np.column_stack([g / unit, np.ones(len(g))])
        answer = np.linalg.lstsq(columns, y, rcond=None)[0]
        left = np.nan_to_num((y - columns @ answer) / size, nan=1e3)
        return answer / np.array([unit, 1.0]), left

    best: tuple[float, dict[str, float]] = (math.inf, {})
    for start in shape.starts(low, high):
        inner = np.array([start[name] for name in shape.inner])
        if len(inner):
            ends = shape.bounds(low, high)
            bounds = tuple(np.transpose([ends[name] for name in shape.inner]))
            inner = np.clip(inner, *bounds)
            inner = least_squares(
                lambda v: linear(v)[1], inner, x_scale=0.1 * np.ptp(bounds, axis=0), bounds=bounds
            ).x
        answer, left = linear(inner)
        # A law with more of its own must come nearer, but not nearer than the curve is known.
        penalty = (2 + len(inner)) * math.log(len(x))
        off = len(x) * math.log(float(np.mean(left**2)) + _EXACT) + penalty
        if off < best[0] and answer[0] != 0.0:
            values = dict(zip(shape.inner, inner.tolist(), strict=True))
            best = off, {"size": float(answer[0]), "level": -float(answer[1] / answer[0]), **values}
    return best


def shape_effect(
    shape: Shape, term: NonparametricTerm, argument: Argument, values: Mapping[str, float]
) -> Effect:
    """Build the effect that stands in the place of a curve.

    Args:
        values: ``size``, ``level`` and the further parameters of the shape, in SI.
    """

    def transform(at: PortView) -> Expression:
        p = {name: at.p[name] for name in ("size", "level", *shape.inner)}
        added = p["size"] * (shape.function(at.signals[argument.name], p) - p["level"])
        return at.value * (1.0 + added) if term.relative else at.value + added

    units = {
        "size": shape.unit(term.unit, argument.unit),
        "level": level_unit(shape, argument),
        **shape.units(argument.unit),
    }
    within = shape.bounds(*argument.hull)
    along = np.linspace(*argument.hull, 60)
    largest = max(abs(float(shape.function(x, values))) for x in along.tolist())
    parameters = []
    for name, unit in units.items():
        value = values[name]
        usual = max(abs(value), largest if name == "level" else 0.0)
        low, high = within.get(name, (-_ROOM * usual, _ROOM * usual))
        parameters.append(Parameter(name, unit, usual or 1.0, "", value, low, high, fitted=True))
    return Effect(EFFECT_NAME, term.ports, transform, parameters=tuple(parameters))


def level_unit(shape: Shape, argument: Argument) -> str:
    """Return the unit of g, of which the level is a value."""
    return _power(argument.unit, shape.power) if shape.power else "1"


def _power(unit: str, power: int) -> str:
    """Return the unit of a power of a quantity."""
    inverse = per("1", unit, power)
    top, _, bottom = inverse.partition("/")
    bottom = bottom.strip("()")
    return bottom if top == "1" else f"{bottom}/{top}"


def _refitted(
    effect: Effect, base: ProcessNoiseFit, fit_on: Sequence[Observed], priors: Sequence[Prior]
) -> ProcessNoiseFit:
    model = base.model.with_effect(effect)
    own = [
        Prior(f"{EFFECT_NAME}.{q.name}", q.value, 3.0 * abs(q.value) or 1.0, q.lower, q.upper)
        for q in effect.parameters
    ]
    begin = base.refit.values | {q.name: q.mean for q in own}
    started = [extended_start(seen, base.model, model) for seen in fit_on]
    return fit_with_process_noise(
        model, started, (*priors, *own), start=begin, noise_scale=base.noise_scale
    )
