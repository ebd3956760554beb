"""From what a diagnosis computed to its verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from workbench.diagnosis.diagnosis import Diagnosis
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.verdict import Finding, Kind, Value, Verdict

IMPERFECT = 0.1
"""Share of the expected disturbance above which something is still left out."""


def conclude(
    diagnosis: Diagnosis,
    judging: Sequence[Observed],
    data: tuple[dict[str, str], ...],
    next_step: Mapping[str, object],
    seconds: float,
) -> Verdict:
    """Put what a diagnosis found into a verdict.

    Args:
        diagnosis: A diagnosis whose search and free runs are finished.
        judging: Held-out recordings, observed with the nominal model.
        data: Checks of the recordings.
        next_step: What to record next.
        seconds: Time that the diagnosis took, in s.

    Returns:
        The verdict.

    Example:
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> from workbench.diagnosis.estimation.observe import observe
        >>> found, hold_out = example_diagnosis()
        >>> seen = [observe(found.nominal, recording) for recording in hold_out]
        >>> conclude(found, seen, (), {}, 1.0).kind == found.verdict.kind
        True
    """
    outputs = judging[0].used
    fit = held_out_errors(diagnosis, judging)
    units = {q.name: q.unit for q in diagnosis.nominal.outputs if q.name in outputs}
    findings = tuple(_finding(diagnosis, i, fit) for i in range(len(diagnosis.accepted)))
    findings = findings or _without_name(diagnosis, fit)
    kind, sentence = _kind(diagnosis, findings)
    first = diagnosis.rounds[0][0] if diagnosis.rounds else None
    return Verdict(
        kind=kind,
        sentence=sentence,
        model=diagnosis.extended.model,
        findings=findings,
        fit=fit,
        units=units,
        parameters=_parameters(diagnosis.base),
        improved={} if diagnosis.extended is diagnosis.base else _parameters(diagnosis.extended),
        not_testable=tuple(
            {
                "effect": s.entry.name,
                "reason": (
                    f"{100 * s.absorption:.1f} % of its signature can be imitated by parameters"
                    if s.absorption >= 0.99
                    else f"only sizes beyond {s.smallest:.2g} {s.entry.unit} would show"
                ),
            }
            for s in (first.scores if first else ())
            if not s.testable
        ),
        next_experiment=next_step,
        data=data,
        location={
            "before": dict(diagnosis.before.alone) if diagnosis.before else {},
            "after": dict(diagnosis.after.alone) if diagnosis.after else {},
        },
        seconds=seconds,
    )


def _parameters(fit: ProcessNoiseFit) -> dict[str, dict[str, object]]:
    return {
        e.name: {
            "value": e.value,
            "std": e.std,
            "unit": e.unit,
            "prior": e.prior.mean,
            "prior_std": e.prior.std,
            "on_bound": e.on_bound,
        }
        for e in fit.refit.estimates
    }


def held_out_errors(
    diagnosis: Diagnosis, judging: Sequence[Observed]
) -> dict[str, dict[str, float]]:
    """Return the errors of the free runs on all held-out recordings together.

    Args:
        diagnosis: A diagnosis with free runs.
        judging: Held-out recordings, observed with the nominal model.

    Returns:
        Root mean square error by model and output, and the noise of the sensors as
        ``noise_floor``, in SI.

    Example:
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> from workbench.diagnosis.estimation.observe import observe
        >>> found, hold_out = example_diagnosis()
        >>> errors = held_out_errors(found, [observe(found.nominal, r) for r in hold_out])
        >>> errors["extended"]["position"] < errors["refitted"]["position"]
        True
    """
    outputs = judging[0].used
    floor = dict(zip(outputs, judging[0].noise_rms.tolist(), strict=True))
    return {
        label: {o: _rms([run.rmse[o] for run in runs.values()]) for o in outputs}
        for label, runs in diagnosis.runs.items()
    } | {"noise_floor": floor}


def _finding(diagnosis: Diagnosis, index: int, fit: dict[str, dict[str, float]]) -> Finding:
    candidate, alike = diagnosis.accepted[index]
    entry = candidate.entry
    own = [
        e for e in diagnosis.extended.refit.estimates if e.name.startswith(f"{entry.effect.name}.")
    ]
    parameters = {
        e.name.removeprefix(f"{entry.effect.name}."): Value(e.value, e.unit, e.std) for e in own
    }
    share = explained(fit)
    name = f"{entry.effect.name}.{entry.size_parameter}"
    size = next((e for e in own if e.name == name), None)
    about = entry.effect.about
    text = (
        f"Missing: {entry.name.replace('_', ' ')} at {', '.join(entry.ports)}"
        + (
            f", {entry.size_parameter} {size.value:.3g} +- {size.std:.2g} {size.unit}"
            if size
            else ""
        )
        + (f"; cannot be told from {', '.join(alike[1:])}" if len(alike) > 1 else "")
        + (f"; {about.separated_by} would decide" if len(alike) > 1 and about.separated_by else "")
        + "."
    )
    gain, low, _ = candidate.held_out
    return Finding(
        where=entry.ports,
        effect=entry.name,
        alike=alike,
        sentence=text,
        parameters=parameters,
        share_of_excess_explained=share,
        gain=candidate.gain,
        p_value=_by_chance(gain, low),
    )


def _without_name(
    diagnosis: Diagnosis, fit: Mapping[str, Mapping[str, float]]
) -> tuple[Finding, ...]:
    """Say where something is left out that no effect of the library explains."""
    if diagnosis.base.share <= IMPERFECT:
        return ()
    term = diagnosis.free_form
    if term is not None and term.accepted:
        over = " and ".join(a.name for a in term.arguments)
        own = f"{term.effect_name}."
        gain, low, _ = term.held_out
        return (
            Finding(
                where=term.ports,
                effect="free_form",
                alike=("free_form",),
                sentence=(
                    f"Missing at {', '.join(term.ports)}: something that the library has no name"
                    f" for; a curve over {over}{' with a memory' if term.loop else ''} takes away"
                    f" {100 * term.explained:.0f} % of the signal that is missing there."
                ),
                parameters={
                    e.name.removeprefix(own): Value(e.value, e.unit, e.std)
                    for e in diagnosis.extended.refit.estimates
                    if e.name.startswith(own)
                },
                share_of_excess_explained=explained(fit),
                gain=term.gain,
                p_value=_by_chance(gain, low),
            ),
        )
    ports = diagnosis.before.ports(diagnosis.nominal) if diagnosis.before else ()
    if not ports:
        return ()
    sentence = f"Something is left out, most likely at {', '.join(ports)}."
    return (Finding(where=ports, effect=None, alike=(), sentence=sentence),)


def _by_chance(gain: float, low: float) -> float:
    """Probability of a held-out gain whose 99 % interval begins at ``low``."""
    deviation = max((gain - low) / 2.576, 1e-9)
    return 0.5 * math.erfc(gain / deviation / math.sqrt(2))


def explained(fit: Mapping[str, Mapping[str, float]]) -> float:
    """Return the share of the held-out mean square error beyond the noise that is removed.

    Args:
        fit: Errors as `held_out_errors` returns them, in SI.

    Returns:
        The share, the mean over the outputs, 0 to 1, dimensionless; NaN if a run failed.

    Example:
        >>> explained(
        ...     {"refitted": {"y": 5.0}, "extended": {"y": 3.0}, "noise_floor": {"y": 3.0}}
        ... )
        1.0
    """
    shares = []
    for output, noise in fit["noise_floor"].items():
        before = fit["refitted"][output] ** 2 - noise**2
        after = fit["extended"][output] ** 2 - noise**2
        if math.isfinite(before) and before > 0:
            shares.append(1.0 - max(after, 0.0) / before)
    return float(np.clip(np.mean(shares), 0.0, 1.0)) if shares else math.nan


def _kind(diagnosis: Diagnosis, findings: Sequence[Finding]) -> tuple[Kind, str]:
    base, extended = diagnosis.base, diagnosis.extended
    if findings and not diagnosis.accepted:
        if findings[0].effect is not None:
            return "located_unnamed", findings[0].sentence
        return (
            "unexplained",
            f"{findings[0].sentence} No effect of the library explains it on the held-out"
            " recordings.",
        )
    if findings:
        sentence = " ".join(f.sentence for f in findings)
        if extended.share > IMPERFECT:
            sentence += " Something else is still left out."
        if any(len(f.alike) > 1 for f in findings):
            return "named_class", sentence
        sensor = all(c.entry.group == "sensor" for c, _ in diagnosis.accepted)
        return ("sensor" if sensor else "named"), sentence
    if base.share <= IMPERFECT:
        bound = [e for e in base.refit.estimates if e.on_bound]
        if bound:
            names = ", ".join(f"{e.name} at {e.value:.3g} {e.unit}" for e in bound)
            return (
                "parameter",
                "No physics is missing that these recordings can show, but a value is wrong: the"
                f" refit ends on its bound with {names}. Check it, and what the notes say of values"
                " that go with it, such as a load.",
            )
        return (
            "nothing_missing",
            "Nothing is missing that these recordings can show: with refitted parameters the model"
            " predicts them nearly to the noise of the sensors.",
        )
    return (
        "unexplained",
        "Something is left out, but neither a place nor an effect of the library explains it on the"
        " held-out recordings.",
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
