"""What is left of a diagnosis that was interrupted."""

from __future__ import annotations

import json
import traceback

from workbench.diagnosis.diagnosis import Diagnosis
from workbench.diagnosis.verdict import Finding, Value, Verdict
from workbench.model import Model


def interrupted_diagnosis(stop: BaseException) -> Diagnosis | None:
    """Return the diagnosis that was under way when an exception stopped it.

    Args:
        stop: The exception, caught outside of `workbench.diagnosis.diagnose.diagnose`.

    Returns:
        The diagnosis as far as it came; None if it had not refitted the nominal model.

    Example:
        >>> interrupted_diagnosis(KeyboardInterrupt()) is None
        True
    """
    for frame, _ in traceback.walk_tb(stop.__traceback__):
        for value in frame.f_locals.values():
            if isinstance(value, Diagnosis):
                return value
    return None


def interrupted_verdict(
    model: Model, diagnosis: Diagnosis | None, step: str, seconds: float
) -> Verdict:
    """Return a verdict with what was found before an interruption.

    Args:
        model: The nominal model.
        diagnosis: The diagnosis as far as it came, or None.
        step: What was being done, in plain words.
        seconds: Time until then, in s.

    Returns:
        A verdict that claims nothing beyond what had been accepted.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> interrupted_verdict(servo_axis(), None, "refitting", 3.0).kind
        'unexplained'
    """
    accepted = diagnosis.accepted if diagnosis is not None else []
    findings = tuple(
        Finding(
            where=candidate.entry.ports,
            effect=candidate.entry.name,
            alike=alike,
            sentence=f"Found before the interruption: {candidate.entry.name.replace('_', ' ')}.",
            parameters=_parameters(diagnosis, candidate.entry.effect.name),
            gain=candidate.gain,
        )
        for candidate, alike in accepted
    )
    if not findings:
        kind = "unexplained"
    else:
        kind = "named_class" if any(len(f.alike) > 1 for f in findings) else "named"
    names = ", ".join(f.effect.replace("_", " ") for f in findings if f.effect) or "nothing"
    before = diagnosis.before if diagnosis is not None else None
    return Verdict(
        kind,  # type: ignore[arg-type]
        f"Interrupted while {step}; found until then: {names}.",
        diagnosis.extended.model if diagnosis is not None else model,
        findings=findings,
        parameters={
            e.name: {"value": e.value, "std": e.std, "unit": e.unit, "prior": e.prior.mean}
            for e in (diagnosis.base.refit.estimates if diagnosis is not None else ())
        },
        location={"before": dict(before.alone)} if before is not None else {},
        seconds=seconds,
    )


def interrupted_text(model: Model, diagnosis: Diagnosis | None, step: str, seconds: float) -> str:
    """Return ``verdict.json`` of an interrupted diagnosis, marked as such.

    Args:
        model: The nominal model.
        diagnosis: The diagnosis as far as it came, or None.
        step: What was being done, in plain words.
        seconds: Time until then, in s.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> '"interrupted": true' in interrupted_text(servo_axis(), None, "refitting", 3.0)
        True
    """
    data = interrupted_verdict(model, diagnosis, step, seconds).as_data() | {"interrupted": True}
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


def _parameters(diagnosis: Diagnosis | None, effect: str) -> dict[str, Value]:
    estimates = diagnosis.extended.refit.estimates if diagnosis is not None else ()
    return {
        e.name.removeprefix(f"{effect}."): Value(e.value, e.unit, e.std)
        for e in estimates
        if e.name.startswith(f"{effect}.")
    }
