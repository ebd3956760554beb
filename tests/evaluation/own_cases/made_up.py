"""Made-up answers, for tests of the judge, the statistics and the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workbench.diagnosis.verdict import SCHEMA
from workbench.evaluation.own_cases.plan import sizes
from workbench.evaluation.rig.parameters import EFFECTS

ERRORS = {"angle": 2e-4, "pressure_1": 900.0, "pressure_2": 900.0}
LIMIT = {"angle": 1e-4, "pressure_1": 600.0, "pressure_2": 600.0}


def found(
    effect: str | None, where: str, *alike: str, **parameters: tuple[float, float]
) -> dict[str, Any]:
    """Return a finding; parameters as value and standard deviation."""
    return {
        "effect": effect,
        "where": [where],
        "class": [effect, *alike] if effect else [],
        "parameters": {k: {"value": v, "std": s, "unit": ""} for k, (v, s) in parameters.items()},
    }


def verdict(
    *findings: dict[str, Any], kind: str | None = None, scale: float = 1.0
) -> dict[str, Any]:
    """Return a verdict whose extended model errs by `scale` times `LIMIT`."""
    kind = kind or ("named" if findings else "nothing_missing")
    factors = {"refitted": 3.0, "extended": scale, "noise_floor": 1.0}
    errors = {name: {k: f * v for k, v in LIMIT.items()} for name, f in factors.items()}
    fit = {"held_out": errors}
    return {"schema": SCHEMA, "verdict": kind, "findings": list(findings), "fit": fit}


def row(
    number: int,
    effects: Sequence[str],
    said: dict[str, Any],
    *,
    kind: str | None = None,
    factor: float = 1.0,
    **baselines: dict[str, Any],
) -> dict[str, Any]:
    """Return what would be kept of a case."""
    true: dict[str, float] = {"load": 3.0, "load_inertia_per_kg": 0.1368, "load_error": 0.0}
    for effect in effects:
        true |= EFFECTS[effect].parameters | sizes(effect, factor)
    plain = "nothing" if not effects else "single" if len(effects) == 1 else "pair"
    return {
        "case": f"own-{number}",
        "title": "+".join(effects) or "nothing",
        "kind": kind or plain,
        "effects": list(effects),
        "factor": factor,
        "true": true,
        "limit": LIMIT,
        "version": "none",
        "scores": [{"effect": "tilt_gravity", "smallest": 0.01}],
        "processor_seconds": 10.0,
        "verdict": said,
        "baselines": baselines,
    }
