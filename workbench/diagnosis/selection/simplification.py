"""The simpler law that an effect is where its shape ended on a bound or shows nowhere."""

from __future__ import annotations

from dataclasses import replace

from workbench.diagnosis.estimation.priors import Prior, entry_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.selection.moments import level_everywhere
from workbench.diagnosis.selection.refit_in_turn import Basis, in_turn
from workbench.diagnosis.selection.rules import SAME
from workbench.diagnosis.selection.selected import Accepted, Selected
from workbench.diagnosis.selection.task import Task
from workbench.physics.library import Hypothesis, look_alikes

_UNTOLD = 0.9
"""Standard deviation over that of its prior from which on recordings tell nothing of a shape."""


def simplified(task: Task, state: Selected) -> Selected:
    """Take a simpler law instead of an effect whose shape ended where it is that law."""
    # Beside what was found later nobody has compared them yet.
    first = state.rounds if len(state.accepted) == 1 else ()
    judged = {c.name for r in first for c in r.candidates if c.followed}
    for found in state.accepted:
        entry, full = found.candidate.entry, state.extended
        name, size = entry.name, entry.size_name
        own = {e.name: e for e in full.refit.estimates if e.name.startswith(f"{name}.")}
        ended = any(
            e.on_bound or e.std > _UNTOLD * e.prior.std for e in own.values() if e.name != size
        )
        # What differs between recordings and ends alike in all of them is the same without.
        level = level_everywhere(full.model.effect(name))
        shorter = [
            e
            for e in look_alikes(entry, task.tried(state.extended.model.without(name)))
            if e.ports == entry.ports and not e.effect.about.begins
            if len(entry_priors(e)) < len(own) + (level is not None)
            if ended or level is not None or e.name not in judged
        ]
        without = task.without(state, found) if shorter and size in own else None
        if without is None:
            continue
        base, free = without
        basis = Basis(base, free, task.started(task.fitting, base.model))
        values = {k: v for k, v in full.refit.values.items() if k not in own}
        amount = own[size].value * (1.0 if level is None else level)
        for simpler in shorter:
            other = _begun(simpler, entry, amount)
            if other.replaces or other.unit != entry.unit:
                continue
            begin = values | {other.size_name: amount}
            try:
                other, fit, _ = in_turn(basis, other, begin, full.noise_scale)
            except Exception:  # noqa: BLE001
                # What cannot be fitted is no simpler law.
                continue
            if fit.cost < state.extended.cost + SAME:
                known = (*free, *entry_priors(other))
                state = _renamed(state, found, other, replace(fit, passed=None), known)
                break
    return state


def _begun(simpler: Hypothesis, entry: Hypothesis, size: float) -> Hypothesis:
    """Return a law with what was tuned of another one, and bounds as wide as its size asks."""
    tuned = {q.name: q.value for q in entry.effect.parameters if not q.fitted}
    own = []
    for q in simpler.effect.parameters:
        if q.name == simpler.size_parameter:
            reach = 2.0 * abs(size)
            lower = min(q.lower, -reach) if q.lower < 0.0 else q.lower
            own.append(replace(q, lower=lower, upper=max(q.upper, reach)))
        else:
            value = min(max(tuned.get(q.name, q.value), q.lower), q.upper)
            own.append(replace(q, value=value))
    return replace(simpler, effect=replace(simpler.effect, parameters=tuple(own)))


def _renamed(
    state: Selected,
    found: Accepted,
    other: Hypothesis,
    fit: ProcessNoiseFit,
    free: tuple[Prior, ...],
) -> Selected:
    old = found.candidate.entry.name
    alike = tuple(n for n in found.alike if n not in (old, other.name))
    renewed = Accepted(replace(found.candidate, entry=other, fit=fit), (other.name, *alike))
    return replace(
        state,
        accepted=tuple(renewed if a is found else a for a in state.accepted),
        free=free,
        extended=fit,
        fits=(*state.fits[:-1], fit),
        compared=tuple(
            c._replace(effects=tuple(sorted(other.name if n == old else n for n in c.effects)))
            for c in state.compared
        ),
    )
