"""What is still left out beside what was found, and what therefore speaks against a finding."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca
import numpy as np

from workbench.diagnosis.estimation.process_noise import extended_start, perfect_cost
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.location.missing_signal import Occurrence
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.held_out import explained, over_floor, over_noise
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import Value
from workbench.errors import NumericalError
from workbench.model import Effect, Model
from workbench.model.units import in_time

Errors = Mapping[str, Mapping[str, float]]
"""Held-out errors by model and output, as `held_out_errors` returns them, in SI."""


def left_out_too(diagnosis: Diagnosis, fit: Errors) -> str:
    """Say what is still left out beside what was found, by how much, and what would explain it."""
    over = over_noise(fit)
    output = max(over, key=lambda name: over[name])
    if over[output] <= rules.NEAR_NOISE or not _leaves_out(diagnosis):
        return ""
    said = (
        f" Something else is still left out: the held-out error of {output.replace('_', ' ')} is"
        f" {over[output]:.3g} times the noise"
    )
    later = diagnosis.rounds[len(diagnosis.accepted) :]
    tried = [c for _, candidates in later[:1] for c in candidates if c.fit is not None]
    best = max(tried, key=lambda c: c.gain, default=None)
    if best is not None and best.gain < rules.LEAST_GAIN:
        said += ", and no law of the library explains more of it"
    elif best is not None:
        name = best.name.replace("_", " ")
        said += f"; the best candidate for it, {name}, gains {best.gain:.3g} of log likelihood"
    rest = diagnosis.validated and diagnosis.validated.rest
    return f"{said}. {rest.sentence('What is left')}" if rest else f"{said}."


def _leaves_out(diagnosis: Diagnosis) -> bool:
    """Whether the equations with all that was found still leave something out.

    A filter that corrects a level at each sample may leave them next to no doubt where small errors
    add up along a run, to more than uncertain parameters explain. Parameters that are uncertain for
    what is left out explain anything: then single samples are less likely than noise makes them.
    """
    fit, fitting = diagnosis.extended, diagnosis.prepared.fitting
    if fit.noise_scale > rules.IMPERFECT:
        return True
    try:
        begun = [extended_start(seen, diagnosis.nominal, fit.model) for seen in fitting]
        excess = fit.cost - perfect_cost(fit.model, begun)
        if not rules.lacks_little(excess, fitting):
            return True
        over = over_floor(diagnosis.extended, diagnosis.nominal, diagnosis.prepared.judging)
    except (NumericalError, np.linalg.LinAlgError):
        return False
    return max(over.values(), default=0.0) > rules.NEAR_NOISE


def still_missing(before: Location, after: Location) -> float:
    """Return the share of the misfit of the worst place that is left, dimensionless.

    Where no place of the process lacked anything, as beside a sensor that is off, nothing is left.
    """
    missing = before.alone.get(before.best, 0.0)
    return after.alone.get(after.best, 0.0) / missing if missing > rules.LEAST_GAIN else 0.0


def most_missing(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Doubt what was found where most of what was missing is missing still."""
    before, after = diagnosis.before, diagnosis.after
    if before is None or after is None:
        return ()
    share = still_missing(before, after)
    if not share > rules.MOST_LEFT:
        return ()
    place = after.best.replace("_", " ")
    return (f"beside it {100 * share:.0f} % of what was missing is still missing, at {place}",)


def still_off(diagnosis: Diagnosis, fit: Errors) -> tuple[str, ...]:
    """Doubt what was found where equations that leave something out still run far off with it.

    Or where they are trusted, and yet most of the error beyond the noise is there without it too.
    """
    share, over = 1.0 - explained(fit), max(over_noise(fit).values())
    little = share > 1.0 - rules.LEAST_SHOWN and over > rules.NEAR_NOISE
    beyond = min((over**2 - 1.0) / (rules.NEAR_NOISE**2 - 1.0), 1.0)
    if not (little or (share * beyond > rules.MOST_OFF and _leaves_out(diagnosis))):
        return ()
    return (f"{100 * share:.0f} % of the mean square error of the held-out runs is left",)


def too_quick(diagnosis: Diagnosis, own: Mapping[str, Value]) -> tuple[str, ...]:
    """Doubt a memory that may last no longer than a sample: without one it is another law.

    A time constant is known by factors, so that one beyond what was recorded is no doubt.
    """
    sample = max(seen.sample_time for seen in diagnosis.prepared.fitting)
    return tuple(
        f"its {name.replace('_', ' ')} may be shorter than a sample, {in_time(sample)}"
        for name, q in own.items()
        if name.endswith("time_constant")
        and q.value * math.exp(-rules.SURE_OF * q.std / q.value) < sample
    )


def beside_larger(diagnosis: Diagnosis, index: int) -> tuple[str, ...]:
    """Doubt what does so little beside another finding that it may be the rest of its shape."""
    validated = diagnosis.validated
    own = validated.occurrence(index) if validated else None
    if validated is None or own is None:
        return ()
    model = diagnosis.nominal
    others = ((i, validated.occurrence(i)) for i in range(len(diagnosis.accepted)) if i != index)
    larger = [(o.largest, i) for i, o in others if o is not None and _add_up(model, o, own)]
    most, which = max(larger, default=(0.0, 0))
    if own.largest >= rules.BESIDE_LARGER * most:
        return ()
    name = diagnosis.accepted[which].candidate.name.replace("_", " ")
    return (
        f"it is {100 * own.largest / most:.0f} % of {name} at {own.port}, of whose shape it may be"
        " the rest",
    )


def _add_up(model: Model, one: Occurrence, other: Occurrence) -> bool:
    """Say whether two signals are at one place, or add up in the rate of a state."""
    names = [port.name for port in model.ports]
    if one.port == other.port or one.unit != other.unit or {one.port, other.port} - {*names}:
        return one.port == other.port
    entered = [model.exact.rates_by_port[:, names.index(o.port)] for o in (one, other)]
    return any(
        not (a.is_zero() or b.is_zero()) for a, b in zip(*map(ca.vertsplit, entered), strict=True)
    )


def differs(effect: Effect, rest: str) -> tuple[str, ...]:
    """Doubt what is another in each recording where the equations still leave something out.

    Recordings do different things: what bends another law acts differently in each of them.
    """
    if not (effect.about.level and rest):
        return ()
    return ("it is another in each recording, as what is left out may be",)
