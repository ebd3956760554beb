"""Parameters that are none: they go with what is measured, with how they are driven, or end."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import casadi as ca

from workbench.model import Effect, Model, Names, Parameter, PortView
from workbench.model.regularisation import Expression
from workbench.model.units import same_dimension
from workbench.physics.drift import parameter_amount
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    Site,
    flag,
    known,
    reference,
    shape,
    share,
    size,
    with_subject,
)
from workbench.physics.parameter_arguments import (
    argument,
    dissipating,
    driving,
    gained,
    may_bend_over,
    own_states,
    own_vector,
)
from workbench.physics.place import FLOWS, Local, Place
from workbench.physics.survey import Survey


def _changing(q: Parameter, places: Sequence[Place], *over: Local) -> tuple[Site, ...]:
    """Return the ports of a parameter that changes there with a signal: one, or one of each."""
    each_over = over if len(over) > 1 else over * len(places)
    return tuple(
        (replace(at, parameters=(q,)).with_signal("over", own),)
        for at, own in zip(places, each_over, strict=True)
    )


def _each_parameter_over(survey: Survey) -> Iterator[Fit]:
    for q, places in (*gained(survey), *survey.fixed):
        for over in may_bend_over(survey, q, places):
            ends = "_".join(filter(None, (over.source, over.minus)))
            yield f"_{q.name}_over_{ends}", _changing(q, places, over)
        through = survey.passing(q) or places
        if q.fitted and (own := own_states(survey, through)):
            yield f"_{q.name}_over_each_{own[0].source}", _changing(q, through, *own)
            if vector := own_vector(own):
                yield f"_{q.name}_over_all_{own[0].source}", _changing(q, through, vector)


def _range(at: Place) -> tuple[Own, Own]:
    """Return middle and half of the range of what a parameter changes with."""
    over = at.over
    low, high = over.seen or (over.start - over.scale, over.start + over.scale)
    return (
        shape("middle", over.unit, 0.5 * (low + high), "middle of the range seen",
              around=None, source="", fitted=False),
        known("reach", over.unit, 0.5 * (high - low) or 1.0, "half of the range seen"),
    )  # fmt: skip


def _shift(at: Place) -> Own:
    """Return by how much a parameter that no refit changes is off in the middle of its curve."""
    q = at.changed
    return shape("shift", q.unit, 0.0, "change in the middle of a parameter that is not refitted",
                 between=(-10.0 * q.scale, 10.0 * q.scale), scale=0.3 * q.scale, source="",
                 fitted=bool(at.parameters) and not q.fitted)  # fmt: skip


def _never_negative(at: Place) -> float:
    """Return 1 for a parameter that is never negative, 0 for another."""
    return 1.0 if at.changed.lower >= 0.0 else 0.0


def _added_up(at: Place) -> tuple[Own, Own]:
    """Return whether a parameter falls towards zero only, and whether it does so by a sum."""
    return (
        flag("one_sided", _never_negative(at), "1 for a parameter that falls towards zero only"),
        flag("added", 0.0, "1 where it does so by a sum, 0 by factors"),
    )


_STEEP = 20.0
"""Steepness of what is a step."""


def _curves(at: Place) -> tuple[dict[str, float], ...]:
    """Return a line, a parabola, a step where the signal changes its sign, and what falls by a sum.

    What is charged resists otherwise than what is discharged.
    """
    straight, parabola = {"bend": 0.0, "added": 0.0}, {"bend": 0.5 * math.pi}
    curves = (straight, parabola, *[{"added": 1.0}] * int(_never_negative(at)))
    low, high = at.over.seen or (0.0, 0.0)
    if not low < 0.0 < high:
        return curves
    return (*curves, {"place": -(low + high) / (high - low), "steepness": _STEEP})


_MOST_GROWN, _LEAST_LEFT = 10.0, 1e-3
"""Logarithm of how much larger than in the middle a parameter may be at an end of its curve, and
what of it there is left at least where it falls by a sum; dimensionless."""


def _along(
    curve: Callable[[Names, Expression, Expression], Expression],
) -> Callable[[PortView], Expression]:
    """Let a parameter be a curve over the signal that it changes with."""
    return lambda at: with_subject(at, curve(at.p, ca.SX(at.subject), at.signals.over))


def _curve(p: Names, own: Expression, over: Expression) -> Expression:
    steep = p.steepness + 1e-6
    along = ca.tanh(steep * ((over - p.middle) / p.reach - p.place)) / ca.tanh(steep)
    change = p.shift + p.amount * (ca.cos(p.bend) * along + ca.sin(p.bend) * (along**2 - 1.0))
    # What is never negative falls and grows by factors, or by a sum as far as that goes.
    grown = own * ca.exp(ca.fmin(change / (own + 1e-300), _MOST_GROWN))
    kept = ca.if_else(p.added > 0.5, ca.fmax(own + change, _LEAST_LEFT * own), grown)
    return ca.if_else(p.one_sided > 0.5, kept, own + change)


def along_curve(model: Model, effect: Effect) -> dict[float, float]:
    """Return a parameter that is a curve, in SI, by the signal that it changes with, in SI.

    At both ends of what was seen of that and in the middle; empty of any other effect.
    """
    curve = _CURVES.get(effect.about.equation)
    if curve is None:
        return {}
    own = {q.name: model.parameter(f"{effect.name}.{q.name}").value for q in effect.parameters}
    p, value = Names("parameter", own), model.parameter(effect.about.subject).value
    places = [p.middle + side * p.reach for side in (-1.0, 0.0, 1.0)]
    return {float(at): float(curve(p, value, ca.DM(at))) for at in places}


def _resisting(survey: Survey) -> Iterator[Fit]:
    """Yield parameters that divide or multiply what drives a flow: a resistance, a conductance."""
    for q, places in gained(survey):
        fills = q.lower >= 0.0 and any(at.role in FLOWS for at in places)
        if fills and (over := driving(survey, q, places)):
            yield f"_{q.name}", _changing(q, places, over)


def _hindered(at: PortView) -> Expression:
    root = ca.sqrt(1.0 + 4.0 * at.p.part * ca.fabs(at.signals.over) / at.p.largest + 1e-12)
    own, times = ca.SX(at.subject), 0.5 * (1.0 + root)
    conducts = ca.jacobian(ca.jacobian(ca.SX(at.value), own), own).is_zero()
    return with_subject(at, own / times if conducts else own * times)


# The smaller the flow the more it is laminar: r q + part r^2 / d q |q| = d at the largest drive d.
turbulent_flow = Law(
    "turbulent_flow",
    "q (1 + sqrt(1 + 4 part |d| / d_largest)) / 2 = d / resistance",
    _resisting,
    lambda at: (
        size("part", "1", 0.3, 100.0, "turbulent part of the resistance, over the laminar one"),
        reference("largest", "1", at.over.largest, "largest drive seen"),
    ),
    _hindered,
    of_parameter=True,
    source="J. Weisbach 1845: losses of bends, valves and orifices",
    look_alikes=("parameter_curve", "outflow_exponent"),
    separated_by="small flows against large ones, in both directions",
)


def _polarised(survey: Survey) -> Iterator[Fit]:
    """Yield resistances of what a current passes through: electrodes resist more a small one."""
    for q, places in gained(survey):
        passed = dissipating(survey, q, places)
        if passed and same_dimension(q.unit, "ohm") and same_dimension(passed.unit, "A"):
            yield f"_{q.name}", _changing(q, places, passed)


def _activation(at: Place) -> tuple[Own, ...]:
    most = at.over.largest
    volts = most * at.changed.scale
    return (
        size("slope", "V", 0.1 * volts, 100.0 * volts, "voltage for e times the current"),
        shape("exchange_current", "A", 0.02 * most, "current of the electrode in both directions"
              " at rest", around=(1e-4, 50.0)),
    )  # fmt: skip


def _activated(at: PortView) -> Expression:
    doubled = 2.0 * at.p.exchange_current
    current = ca.sqrt(at.signals.over**2 + (1e-6 * doubled) ** 2)
    return with_subject(at, at.subject + at.p.slope * ca.asinh(current / doubled) / current)


# Batteries, fuel cells, electrolysers, baths of a plater.
activation_overvoltage = Law(
    "activation_overvoltage",
    "resistance i + slope asinh(i / (2 exchange_current))",
    _polarised,
    _activation,
    _activated,
    of_parameter=True,
    source="J. Tafel 1905; Bard and Faulkner, Electrochemical Methods, 2001, 3.4 (Butler-Volmer)",
    look_alikes=("parameter_curve", "offset"),
    separated_by="small currents against large ones, in both directions",
)


# A parameter that is none: it changes with what is measured. Bl of a loudspeaker with the excursion
# of the coil, the force of a magnet with the current that saturates its iron, a resistance with a
# temperature.
parameter_curve = Law(
    "parameter_curve",
    "parameter + c, or parameter exp(c / parameter) as well where it is never negative,"
    " c = shift + amount (cos(bend) z + sin(bend) (z^2 - 1)), z = tanh(s (x - place)) / tanh(s),"
    " s = steepness, x = (signal - middle) / reach",
    _each_parameter_over,
    lambda at: (
        parameter_amount(at),
        shape("bend", "rad", 0.0, "from a straight line, 0, to a parabola, pi/2",
              between=(-math.pi, math.pi), scale=1.0),
        shape("place", "1", 0.0, "where it is steepest, over half of the range seen",
              between=(-1.5, 1.5), scale=0.3, refined=True),
        shape("steepness", "1", 0.0, "how much it is a step there, from a straight line, 0",
              between=(0.0, 30.0), scale=1.0, refined=True),
        _shift(at),
        *_added_up(at),
        *_range(at),
    ),
    _along(_curve),
    shapes=_curves,
    # A straight line is as steep everywhere.
    details={"steepness": 4.0},
    of_parameter=True,
    source="saturating iron, warm windings, fields that fade at the ends of a travel",
    look_alikes=("parameter_fade", "parameter_jump", "cubic_stiffness"),
    separated_by="the same motion about several positions",
)  # fmt: skip


def _raised(survey: Survey) -> Iterator[Fit]:
    """Yield parameters that are never negative, each with a signal that is not either."""
    for suffix, sites in _each_parameter_over(survey):
        at = sites[0][0]
        low, high = at.over.seen or (0.0, 0.0)
        if at.changed.fitted and _never_negative(at) and 0.0 <= low < 0.7 * high:
            yield suffix, sites


def _power(p: Names, own: Expression, over: Expression) -> Expression:
    share = over / p.middle
    return own * ca.fmax(share, _LEAST_LEFT) ** p.exponent


# The coefficient of a film with a flow, a resistance of a wire with an absolute temperature.
parameter_power = replace(
    parameter_curve,
    name="parameter_power",
    equation="parameter (signal / middle)^exponent",
    where=_raised,
    parameters=lambda at: (
        size("exponent", "1", 0.5, 5.0, "exponent of the signal", signed=True),
        *_range(at),
    ),
    transform=_along(_power),
    shapes=lambda at: ({},),
    details={},
    source="F. Dittus and L. Boelter 1930: films of heat, by flow^0.8; similarity laws",
    look_alikes=("parameter_curve", "parameter_fade"),
    separated_by="the same motion at a small and at a large value of the signal",
)


def _halved(p: Names, own: Expression, over: Expression) -> Expression:
    share = ca.fmax(over / p.middle, _LEAST_LEFT)
    return own / (1.0 + p.part * share**-p.exponent)


# Oil with air in it, by the square of its pressure; an uptake by what is taken up, or by what
# poisons it; a film over which something else stands in the way.
parameter_hill = replace(
    parameter_power,
    name="parameter_hill",
    equation="parameter / (1 + part (middle / signal)^exponent)",
    parameters=lambda at: (
        size("part", "1", 0.3, 100.0, "what stands in its way in the middle, over the parameter"),
        shape("exponent", "1", 1.0, "exponent of the signal", between=(-6.0, 6.0)),
        *_range(at),
    ),
    transform=_along(_halved),
    shapes=lambda at: [{"exponent": k} for k in (1.0, 2.0, -1.0, -2.0)],
    source="A. V. Hill 1910; J. Monod 1949; H. E. Merritt 1967, 2.3: air in oil; resistances in a"
    " row",
    look_alikes=("parameter_curve", "parameter_power"),
)

_CURVES = {
    parameter_curve.equation: _curve,
    parameter_power.equation: _power,
    parameter_hill.equation: _halved,
}
"""What laws of parameters that are curves of a signal make of one, by their equation."""


def _terms(survey: Survey) -> Iterator[Fit]:
    for q, places in gained(survey):
        if over := argument(survey, q, places):
            yield f"_{q.name}", _changing(q, places, over)


def _clipped(at: PortView) -> Expression:
    over, knee = ca.fabs(at.signals.over) / at.p.limit + 1e-12, at.p.knee
    left = (1.0 + over ** (1.0 / knee)) ** -knee
    return with_subject(at, ca.SX(at.subject) * (1.0 - at.p.share * (1.0 - left)))


_HARD = 0.02
"""Knee of what is clipped."""


# The speed that a position loop asks for, the torque that a coupling or a belt holds, the current
# that a converter gives: what the equations ask of it in proportion ends somewhere.
term_saturation = Law(
    "term_saturation",
    "parameter x / (1 + |x / limit|^(1/knee))^knee, x what it multiplies",
    _terms,
    lambda at: (
        share("share of the excess that is cut"),
        shape("limit", at.over.unit, 0.5 * at.over.scale, "the limit of what it multiplies",
              around=(0.01, 20.0)),
        shape("knee", "1", _HARD, "how gently it sets in: a clip, 0, to a hyperbola, 1",
              between=(_HARD, 1.5), scale=0.2, refined=True),
    ),
    _clipped,
    shapes=lambda at: [
        {"limit": k * at.over.scale, "knee": knee}
        for k, knee in ((0.5, _HARD), (0.8, _HARD), (0.25, _HARD), (0.1, _HARD), (0.5, 0.5))
    ],
    of_parameter=True,
    source="limits of speed, torque and current within cascaded loops; C. Rapp 1991; belts, tyres",
    look_alikes=("slew_limit", "saturation", "parameter_curve"),
    separated_by="steps from small to large: the answer to the large ones takes longer",
)  # fmt: skip


def _slack(at: PortView) -> Expression:
    p, tense = at.p, at.p.sense * at.signals.over
    lost = at.form.ramp(-p.holds - tense, 0.01 * p.usual)
    # Beyond what it holds, which is on the far side of zero, nothing is divided by zero.
    return with_subject(at, at.subject * (1.0 + p.share * lost / ca.fmin(tense, -1e-9 * p.usual)))


def _loads(at: Place) -> list[float]:
    """Return what a contact may hold until it lifts: nothing, or a part of what was seen."""
    return [part * at.over.largest for part in (0.0, 0.1, 0.3, 0.6)]


# What pushes does not pull: tyres and cams lift, ropes and chains go slack, with a load on them a
# little later.
term_slack = Law(
    "term_slack",
    "parameter sense max(sense x, -holds), x what it multiplies",
    _terms,
    lambda at: (
        share("share of what is lost"),
        shape("holds", at.over.unit, 0.1 * at.over.scale, "how far the other way it holds",
              between=(0.0, 20.0 * at.over.scale), scale=at.over.scale),
        flag("sense", 1.0, "1 if it goes on above zero, -1 below", lower=-1.0),
        known("usual", at.over.unit, at.over.largest, "largest seen"),
    ),
    _slack,
    shapes=lambda at: [{"holds": k, "sense": s} for s in (1.0, -1.0) for k in _loads(at)],
    far=True,
    of_parameter=True,
    source="unilateral contact: A. Signorini 1959",
    look_alikes=("term_saturation", "parameter_curve", "end_stop"),
    separated_by="the same motion with another load on the contact",
)  # fmt: skip
