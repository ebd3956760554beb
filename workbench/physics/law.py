"""Laws: pieces of physics that state once all that is known of them, for any port that they fit.

A law takes units, usual sizes and signals from the port at which it is used. Called with a port it
is an effect, ``coulomb_friction("axis.force", level=20.0)``; over a whole model it gives the
hypotheses of what the model may lack. A law of your own stands in the registry `LAWS` through the
entry point ``workbench.effects``, or is named as ``module:object``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any

import casadi as ca

from workbench.errors import WorkbenchError, check_choice
from workbench.model import (
    About,
    Effect,
    EffectView,
    Model,
    Names,
    Parameter,
    PortView,
    State,
)
from workbench.model.expressions import cofactor, weight
from workbench.model.regularisation import Expression
from workbench.model.units import per
from workbench.physics.hypothesis import Group, Hypothesis
from workbench.physics.place import DRIVES, Local, Place, unknown_place
from workbench.physics.survey import Survey
from workbench.registry import Registry

EVERYWHERE = ("*",)
"""Ports of an effect that is attached wherever its law fits."""


@dataclass(frozen=True)
class Own:
    """A parameter of a law at a place; made by `size` and `shape`.

    Args:
        value: Value unless another is given, in ``unit``.
        lower: Smallest plausible value, in ``unit``; a multiple of the value if ``relative``.
        upper: Largest plausible value, in ``unit`` or as such a multiple.
        scale: Typical magnitude, in ``unit``; the value's by default.
        relative: Whether the bounds are multiples of the value.
        typical: Of the size of a law: its usual magnitude, in ``unit``; 0 for other parameters.
        absent: Value in a hypothesis, where that differs, in ``unit``.
        resists: Whether it has the sign of a resistance against the motion.
        refined: Whether it is refitted as soon as the law was found, and not before.
        read: Unit in which people read it; that of its place by default.
        strict: Whether beyond its bounds the law is another one.
    """

    name: str
    unit: str
    value: float
    lower: float
    upper: float
    text: str
    scale: float = 0.0
    source: str = "estimate"
    fitted: bool = True
    relative: bool = False
    typical: float = 0.0
    absent: float | None = None
    resists: bool = False
    refined: bool = False
    read: str = ""
    strict: bool = False

    def either_way(self) -> Own:
        """Return the parameter with both signs, if it is a size that only resists a motion."""
        return replace(self, lower=-self.upper) if self.resists and self.lower == 0.0 else self

    def parameter(self, given: float | None, *, bounded: bool) -> Parameter:
        """Return the parameter, with another value if one is given.

        Args:
            given: The value, in ``unit``, or nothing.
            bounded: Whether the bounds hold for a given value; else they make room for it.
        """
        value = self.value if given is None else float(given)
        lower, upper = self.lower, self.upper
        if self.relative:
            around = value if not bounded else self.value
            # Of a level below zero, or at it, no multiple is a bound.
            lower, upper = (
                (lower * around, upper * around) if around > 0.0 else (-math.inf, math.inf)
            )
        elif self.typical and not bounded:
            # The size that an author gives says more than the scale of a port.
            upper = upper if value <= upper else 20.0 * abs(value)
            lower = lower if value >= lower or lower >= 0.0 else -20.0 * abs(value)
        return Parameter(
            self.name,
            self.unit,
            self.scale,
            self.text,
            value,
            lower,
            upper,
            self.source,
            fitted=self.fitted,
            refined=self.refined,
            display_unit=self.read,
            strict=self.strict,
        )


def size(
    name: str,
    unit: str,
    typical: float,
    largest: float,
    text: str,
    *,
    signed: bool = False,
    lower: float | None = None,
    scale: float = 0.0,
    source: str = "",
    resists: bool = False,
) -> Own:
    """State the parameter of a law whose zero is the law's absence.

    Args:
        typical: Usual magnitude, in ``unit``: a first guess from the port's scale.
        largest: Largest plausible magnitude, in ``unit``.
        lower: Smallest value, in ``unit``, where that is neither 0 nor minus the largest.
        scale: Scale of a fit, in ``unit``; the usual magnitude by default.
        resists: Whether it is a resistance against the motion: it has either sign at a port of
            which the equations do not tell which way it counts.
    """
    below = lower if lower is not None else (-largest if signed else 0.0)
    return Own(
        name, unit, 0.0, below, largest, text, scale or typical, source,
        typical=typical, resists=resists,
    )  # fmt: skip


def size_at(
    of: Place | Local | Parameter,
    name: str,
    typical: float,
    largest: float,
    text: str,
    *,
    over: Local | None = None,
    power: int = 1,
    signed: bool = False,
    source: str = "",
    resists: bool = False,
) -> Own:
    """State the size of a law by that of a place, signal or parameter, as `size` does in units.

    Args:
        of: What has the unit and the typical size.
        typical: Usual magnitude over that, dimensionless.
        largest: Largest plausible magnitude over that, dimensionless.
        over: What divides both, to a power.
    """
    unit, by = of.unit, 1.0
    if over is not None:
        unit, by = per(unit, over.unit, power), over.scale**power
    usual, most = (part * of.scale / by for part in (typical, largest))
    return size(name, unit, usual, most, text, signed=signed, source=source, resists=resists)


def gain_of(at: Place, cause: Local, part: float, text: str) -> Own:
    """State the gain of a law with which another signal enters at a place; its zero is its absence.

    Args:
        part: What the cause's usual size usually brings in, over the place's scale, a ratio.
    """
    typical = part * at.scale / cause.scale
    return size("gain", per(at.unit, cause.unit), typical, 100.0 * typical, text, signed=True)


def share(text: str) -> Own:
    """State the share of a law that is either there (1) or not (0)."""
    return Own("share", "1", 0.0, 0.0, 1.0, text, 1.0, "", False, typical=1.0)


def shape(
    name: str,
    unit: str,
    value: float,
    text: str,
    *,
    around: tuple[float, float] | None = (0.1, 10.0),
    between: tuple[float, float] | None = None,
    scale: float = 0.0,
    source: str = "estimate",
    fitted: bool = True,
    absent: float | None = None,
    refined: bool = False,
    read: str = "",
    strict: bool = False,
) -> Own:
    """State another parameter of a law.

    Args:
        value: Usual value, in ``unit``.
        around: Bounds as multiples of the value, dimensionless; None for no bounds.
        between: Bounds in ``unit``, in place of those.
        scale: Scale of a fit, in ``unit``; the value's by default.
        absent: Value in a hypothesis, where that differs, in ``unit``.
        refined: Whether it is a detail, refitted as soon as the law was found and not before.
        read: Unit in which people read it; that of its place by default.
        strict: Whether beyond its bounds the law is another one, so that no fit widens them.
    """
    lower, upper = between or around or (-math.inf, math.inf)
    return Own(
        name, unit, value, lower, upper, text, scale or abs(value) or 1.0, source,
        fitted and not refined, relative=bool(around and not between), absent=absent,
        refined=refined, read=read, strict=strict,
    )  # fmt: skip


def known(name: str, unit: str, value: float, text: str) -> Own:
    """State a number, in ``unit``, that is as it is, and that no fit changes."""
    return shape(name, unit, value, text, around=(1.0, 1.0), source="", fitted=False)


def reference(name: str, unit: str, value: float, text: str) -> Own:
    """State the number, in ``unit``, at which a law tells its size: of another, another size.

    It is no guess: no fit changes it, and nothing is unsure of it.
    """
    return shape(name, unit, value, text, around=(0.2, 5.0), source="", fitted=False)


def flag(name: str, value: float, text: str, *, lower: float = 0.0) -> Own:
    """State which of its forms a law has, up to 1 (dimensionless), which no fit changes."""
    return shape(name, "1", value, text, between=(lower, 1.0), source="", fitted=False)


def floor(at: Place, intervals: float) -> Own:
    """State the time that keeps a law regular at zero size: short beside what samples show.

    Args:
        intervals: How many sampling intervals it is, dimensionless.
    """
    return known("floor", "s", intervals * at.interval, "time that keeps it regular at zero size")


def rounding(at: Place) -> Own:
    """State the speed within which the regularised form of a law rounds the reversal."""
    text = "speed that rounds the reversal in regularised equations"
    return known("rounding_speed", at.speed.unit, 1e-5 * at.speed.scale, text)


Site = tuple[Place, ...]
"""The places that one element of a law joins: one, or a pair such as a tube's two ends."""

Fit = tuple[str, tuple[Site, ...]]
"""What a law's name gets behind it, and the sites that share its parameters."""

Where = Callable[[Survey], Iterable[Fit]]
Rates = Callable[[EffectView], Mapping[str, Expression]]


@dataclass(frozen=True, eq=False)
class Law:
    """A law of physics for any model with a port that it fits.

    ``transform`` gives the new signal at a port, ``rates`` the rates of the law's own states and
    ``start`` their values at the start of a run. They see the port's signal as ``at.value``, its
    typical size as ``at.scale``, own parameters and states as ``at.p`` and ``at.x``, and by
    ``at.signals`` the port's local signals and the ``speed``, ``coordinate`` or ``level`` that
    belongs to it, whatever the author of the plant has called them. What a law says of itself, its
    ``moment`` to ``advance`` too, is what `About` says of an effect.

    Args:
        name: Name of the law and, at the only port that it fits, of the effect.
        where: Where in a model it may act: `each`, `twins`, `sensors`, or a function of your own.
        parameters: Own parameters at a place: one `size` or `share`, and any number of `shape`.
        start: Own states at the start of a run, where they are not zero.
        shapes: Values of other parameters worth trying before a fit, by short name; the first are
            the law's own.
        details: Values of details from which their refit begins, in their units, where that is not
            where they stand.
        dry: Whether it is friction or play without a slope at rest.
        stiff: Whether it brings rates well beyond 1000 1/s: explicit integrators need short steps.
        far: Whether its usual sizes are beyond where the derivative at size zero tells of them, as
            with delays: a refit then begins at the priors too.
        whole: Whether the largest size is all that there can be, such as the whole of a load.
        usual: Whether machines usually have some of it that nobody tells a controller of.
        evident: Whether the recordings themselves show it at a place: a score is not asked.
        downhill: Whether it acts at the first of its ports, the others only take what it gives off.
        same_as: Names of hypotheses that give the very same measurements, of a model and the
            place where the law acts.
        family: Name that it shares with laws of the same kind; its own by default.

    Example:
        >>> drag = Law(
        ...     "drag",
        ...     "T = -coefficient v",
        ...     each("force", needs=("speed",)),
        ...     lambda at: (size("coefficient", "N s/m", 1.0, 10.0, "damping"),),
        ...     lambda at: at.value - at.p.coefficient * at.signals.speed,
        ... )
        >>> from workbench.plants.servo_axis import servo_axis
        >>> [h.ports for h in drag.hypotheses(Survey(servo_axis()))]
        [('axis.force',)]
    """

    name: str
    equation: str
    where: Where
    parameters: Callable[[Place], tuple[Own, ...]]
    transform: Callable[[PortView], Expression]
    states: Callable[[Place], tuple[State, ...]] = lambda at: ()
    rates: Rates | None = None
    start: Rates | None = None
    shapes: Callable[[Place], Sequence[Mapping[str, float]]] = lambda at: ({},)
    details: Mapping[str, float] = field(default_factory=dict)
    group: Group = "process"
    dry: bool = False
    stiff: bool = False
    far: bool = False
    whole: bool = False
    usual: bool = False
    evident: Callable[[Place], bool] = lambda at: False
    of_parameter: bool = False
    moment: str = ""
    period: str = ""
    part: str = ""
    begins: str = ""
    level: bool = False
    tells: str = ""
    advance: str = ""
    downhill: bool = False
    same_as: Callable[[Survey, Place], tuple[str, ...]] = lambda *_: ()
    family: str = ""
    source: str = ""
    look_alikes: tuple[str, ...] = ()
    separated_by: str = ""

    def __call__(
        self,
        ports: str | Sequence[str | Sequence[str]] = EVERYWHERE,
        *,
        name: str = "",
        lower: float | None = None,
        upper: float | None = None,
        typical: float | None = None,
        source: str = "",
        **values: float,
    ) -> Effect:
        """Return the law as an effect at some ports; units are settled when it is attached.

        Args:
            ports: Name of a port, or of several that share the parameters, each with states of
                its own; a list of lists if each element of the law joins several ports. By
                default wherever the law fits first.
            name: Name of the effect; the law's by default.
            lower: Smallest plausible size, in its unit.
            upper: Largest plausible size, in its unit.
            typical: Usual size, in its unit; scales a fit.
            values: Values of the law's parameters, in their units; a usual size where none is
                given.
        """
        several = (ports,) if isinstance(ports, str) else ports
        named = tuple((site,) if isinstance(site, str) else tuple(site) for site in several)
        given = {"lower": lower, "upper": upper, "scale": typical, "source": source or None}
        changes: dict[str, object] = {
            key: value for key, value in given.items() if value is not None
        }

        def settle(effect: Effect, model: Model) -> Effect:
            later = {
                q.name: q.value
                for q, first in zip(effect.parameters, unsettled.parameters, strict=True)
                if q.value != first.value
            }
            sites = self._sites(named, model)
            return self._effect(sites, effect.name, {**values, **later}, changes, bounded=False)

        unsettled = self._effect(
            tuple(tuple(map(unknown_place, site)) for site in named),
            name or self.name,
            values,
            {"lower": -math.inf, "upper": math.inf, **changes},
            bounded=False,
        )
        return replace(unsettled, settle=settle)

    def hypotheses(self, survey: Survey) -> Iterator[Hypothesis]:
        """Yield the law at size zero for every place of a model that it fits."""
        fits = list(self.where(survey))
        offered = {sites[0][0].name for _, sites in fits if len(sites) == 1}
        for suffix, sites in fits:
            together = self._hypothesis(survey, suffix, sites)
            if len(sites) > 1 and self.group == "process":
                # Something wrong with one of a pair is as likely as something left out of both.
                alone = (
                    self._hypothesis(survey, f"{suffix}_{site[0].name.partition('.')[0]}", (site,))
                    for site in sites
                    if site[0].name not in offered
                )
                together = replace(together, alone=tuple(alone))
            yield together

    def _hypothesis(self, survey: Survey, suffix: str, sites: tuple[Site, ...]) -> Hypothesis:
        first = _first(sites)
        own = self._size(first)
        absent = {q.name: q.absent for q in self.parameters(first) if q.absent is not None}
        return Hypothesis(
            self._effect(
                sites, f"{self.name}{suffix}", {own.name: 0.0, **absent}, {}, bounded=True
            ),
            own.name,
            own.typical,
            self.group,
            self.family or self.name,
            tuple(self.shapes(first)),
            self.details,
            self.stiff,
            self.whole,
            self.far,
            self.same_as(survey, first),
            usual=self.usual,
            evident=self.evident(first),
        )

    def _size(self, at: Place) -> Own:
        return next(q for q in self.parameters(at) if q.typical > 0.0)

    def _sites(self, named: tuple[tuple[str, ...], ...], model: Model) -> tuple[Site, ...]:
        survey = _surveyed(model)
        if named == (EVERYWHERE,):
            fits = list(self.where(survey))
            if not fits:
                raise WorkbenchError(
                    f"effect {self.name!r} finds no port of model {model.name!r} that it fits;"
                    f" its ports are {', '.join(q.name for q in model.ports) or 'none'}; name one,"
                    " or give it a role"
                )
            return max((sites for _, sites in fits), key=len)
        return tuple(tuple(map(survey.place, site)) for site in named)

    def _effect(
        self,
        sites: tuple[Site, ...],
        name: str,
        values: Mapping[str, float],
        changes: Mapping[str, object],
        *,
        bounded: bool,
    ) -> Effect:
        first = _first(sites)
        own = self.parameters(first)
        if not first.directed:
            own = tuple(q.either_way() for q in own)
        for key in values:
            check_choice(f"parameter of effect {self.name}", key, [q.name for q in own])
        sites_of = {q.name: (i, k, q) for i, site in enumerate(sites) for k, q in enumerate(site)}
        if len(sites_of) != sum(len(site) for site in sites):
            raise WorkbenchError(f"effect {name!r} acts twice on one of its ports")
        several = len(sites) > 1

        def parameter(q: Own) -> Parameter:
            if not q.typical:
                return q.parameter(values.get(q.name), bounded=bounded)
            stated = replace(q, **changes)  # type: ignore[arg-type]
            within = bounded or "upper" in changes
            return stated.parameter(values.get(q.name, q.typical), bounded=within)

        def weighed(at: PortView) -> Expression:
            """Return by how much more than at the start what a law adds is divided there."""
            usual = sites_of[at.port][2].usual
            if not usual or self.of_parameter:
                return 1.0
            known = {name: ca.SX(at.known[name]) for name in usual if name in at.known}
            found = weight(ca.SX(at.plain), ca.vcat(list(known.values())))
            if found is None:
                return 1.0
            start = ca.DM([usual[name] for name in known])
            return found / ca.substitute(found, ca.vcat(list(known.values())), start)

        def seen(at: PortView) -> PortView:
            number, index, place = sites_of[at.port]
            subject = None
            if place.parameters:
                changed = place.parameters[0].name
                # What acts beside a parameter stays where that was taken away.
                if self.of_parameter or changed in at.parameters:
                    subject = at.parameters[changed]
            found = {
                alias: _multiplied(at, subject)
                if q.multiplied
                else q.value(at.signals, at.known, at.parameters)
                for alias, q in place.signals.items()
                if subject is not None or not q.multiplied
            }
            return replace(
                at,
                index=index,
                value=at.value * weighed(at),
                signals=Names(f"signal at port {at.port}", {**at.signals, **found}),
                x=_numbered(at.x, number) if several else at.x,
                scale=place.scale,
                subject=subject,
            )

        def each(function: Rates, view: EffectView) -> Mapping[str, Expression]:
            result: dict[str, Expression] = {}
            for number, site in enumerate(sites):
                at = {q.name: seen(view.at[q.name]) for q in site}
                x = _numbered(view.x, number) if several else view.x
                end = f"_{number + 1}" if several else ""
                found = function(replace(view, x=x, at=at))
                result |= {f"{key}{end}": value for key, value in found.items()}
            return result

        rates, start = self.rates, self.start
        told: dict[str, Any] = {f.name: getattr(self, f.name, "") for f in fields(About)}
        if self.of_parameter and first.parameters:
            told["subject"] = first.parameters[0].name
        return Effect(
            name,
            tuple(sites_of),
            lambda at: self.transform(seen(at)) / weighed(at),
            parameters=tuple(map(parameter, own)),
            states=tuple(
                replace(q, name=f"{q.name}_{number + 1}") if several else q
                for number, site in enumerate(sites)
                for q in self.states(_first((site,)))
            ),
            rates=(lambda view: each(rates, view)) if rates else None,
            start=(lambda view: each(start, view)) if start else None,
            about=About(**told),
            dry=self.dry,
        )


def _multiplied(at: PortView, subject: Expression) -> ca.SX | None:
    """Return what a parameter multiplies at a port: in the plant, or else in its effects."""
    # Another law may have changed the parameter there.
    found = cofactor(ca.SX(at.plain), ca.SX(subject))
    return cofactor(ca.SX(at.value), ca.SX(subject)) if found is None else found


LAWS = Registry(
    "effect", Law, package=("workbench.physics", "workbench.plants"), group="workbench.effects"
)
"""Every law of the library, those that stand beside a plant, those that installed packages add."""


def each(
    *roles: str,
    needs: tuple[str, ...] = (),
    only: Callable[[Place], bool] = lambda at: True,
    label: Callable[[Place], str] | None = None,
) -> Where:
    """Let a law act at every port of some roles, one by one.

    Args:
        label: What the effect's name gets; nothing by default where there is one port only, else
            the name of the port's component.
    """

    def where(survey: Survey) -> Iterator[Fit]:
        found = [q for q in survey.fitting(*roles, needs=needs) if only(q)]
        groups = [q.port.group for q in found]
        for place in found:
            if label is not None:
                end = f"_{label(place)}"
            elif len(found) == 1:
                end = ""
            else:
                alone = groups.count(place.port.group) == 1
                end = f"_{place.port.group if alone else by_port(place)}"
            yield end, ((place,),)
            if label is None and set(needs) & set(place.carried):
                # What rubs or stops a body may stand still, or go with what carries the body.
                base = next(iter(place.carried.values())).minus
                over = replace(place, signals={**place.signals, **place.carried})
                yield f"{end}_over_{base}", ((over,),)

    return where


def drives(*roles: str, only: Callable[[Place], bool] = lambda at: True) -> Where:
    """Let a law act on what drives a plant: commands, flows of inputs alone, other roles."""
    offered = {*DRIVES, *roles}
    return each(
        *offered, "heat", "flow", label=by_port,
        only=lambda at: (at.role in offered or at.commanded) and not at.empty and only(at),
    )  # fmt: skip


def at_inputs_too(law: Law, only: Callable[[Place], bool] = lambda at: True) -> Law:
    """Let a law of commands act on inputs too that enter the equations through one port alone.

    What else the port carries, such as friction beside the force of a motor, it leaves alone.

    Args:
        only: Tells whether the law fits such an input.
    """

    def own(at: PortView) -> PortView:
        return replace(at, value=at.signals.cause) if "cause" in at.signals else at

    def transform(at: PortView) -> Expression:
        changed = law.transform(own(at))
        if "cause" not in at.signals:
            return changed
        return ca.substitute(ca.SX(at.value), ca.SX(at.signals.cause), ca.SX(changed))

    def seeing(function: Rates | None) -> Rates | None:
        if function is None:
            return None
        return lambda e: function(replace(e, at={name: own(at) for name, at in e.at.items()}))

    def where(survey: Survey) -> Iterator[Fit]:
        alone = [at for at in survey.inputs_alone if only(at)]
        several = {at.name for at in alone}
        yield from (fit for fit in law.where(survey) if fit[1][0][0].name not in several)
        yield from ((f"_{at.signals['cause'].source}", ((at,),)) for at in alone)

    return replace(
        law, where=where, transform=transform, rates=seeing(law.rates), start=seeing(law.start)
    )


def twins(
    *roles: str, needs: tuple[str, ...] = (), only: Callable[[Place], bool] = lambda at: True
) -> Where:
    """Let a law act at all ports of some roles together, with one set of parameters."""

    def where(survey: Survey) -> Iterator[Fit]:
        found = [q for q in survey.fitting(*roles, needs=needs) if only(q)]
        if found:
            yield "", tuple((q,) for q in found)

    return where


def first_of(*wheres: Where) -> Where:
    """Let a law act where the first of several ways finds a place."""

    def where(survey: Survey) -> Iterable[Fit]:
        return next((fits for w in wheres if (fits := list(w(survey)))), [])

    return where


def together(*wheres: Where) -> Where:
    """Let a law act wherever one of several ways finds a place, once at each."""

    def where(survey: Survey) -> Iterator[Fit]:
        fits = {sites[0][0].name: (end, sites) for w in wheres for end, sites in w(survey)}
        yield from fits.values()

    return where


def sensors(*, together: bool = True, only: Callable[[Place], bool] = lambda at: True) -> Where:
    """Let a law act on every sensor and, if wanted, on all of a kind (``name_1``, ``name_2``)."""

    def where(survey: Survey) -> Iterator[Fit]:
        found = [q for q in survey.fitting("measurement") if only(q)]
        kinds: dict[str, list[Place]] = {}
        for place in found:
            own = place.output.name if place.output else by_port(place)
            yield f"_{own}", ((place,),)
            stem, _, number = own.rpartition("_")
            if number.isdigit():
                kinds.setdefault(stem, []).append(place)
        for stem, same in kinds.items():
            if together and len(same) > 1:
                yield f"_{stem}s", tuple((q,) for q in same)

    return where


def by_port(place: Place) -> str:
    """Return the name of a port for use in the name of an effect."""
    return place.name.replace(".", "_")


def by_number(place: Place) -> str:
    """Return the number that the name of a port's component ends on."""
    return place.port.group.rpartition("_")[2]


def by_end(place: Place) -> str:
    """Return the part of a port's name behind the dot."""
    return place.name.partition(".")[2]


def with_subject(at: PortView, value: Expression) -> Expression:
    """Return the signal at a port, in SI, with another value for the parameter that changes.

    Args:
        value: That value, in SI.
    """
    return ca.substitute(ca.SX(at.value), ca.SX(at.subject), ca.SX(value))


_survey = lru_cache(maxsize=4)(Survey)


def _surveyed(model: Model) -> Survey:
    """Survey a model once for all effects that are attached to it together."""
    try:
        return _survey(model)
    except TypeError:  # A model with a list or an array among its fields has no hash.
        return Survey(model)


def _first(sites: Sequence[Site]) -> Place:
    place = sites[0][0]
    return replace(place, others=sites[0][1:])


def _numbered(x: Names, number: int) -> Names:
    end = f"_{number + 1}"
    return Names("state", {k.removesuffix(end): v for k, v in x.items() if k.endswith(end)})
