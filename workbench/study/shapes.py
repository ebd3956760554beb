"""What stands where in a study file: text, numbers, names; checked before anything is built."""

from __future__ import annotations

from workbench.checked_json import (
    Shape,
    TableShape,
    anything,
    flag,
    listed,
    named,
    number,
    size,
    text,
    whole,
)

NAMES = listed(text)
_SIZES = named(size)
_EVENTS = listed(named(size))
_VARIED: dict[str, Shape] = {
    "parameters": _SIZES,
    "effects": NAMES,
    "without": NAMES,
    "noise": size,
}
_SELECTION: dict[str, Shape] = {
    "seeds": whole,
    "scenarios": NAMES,
    "variations": NAMES,
    "judged": flag,
}
_VARIATION = TableShape(
    {},
    {
        **_VARIED,
        "scaled": _SIZES,
        "scenarios": NAMES,
        "controllers": NAMES,
        "disturbances": _EVENTS,
        "ideal": flag,
        "late_samples": whole,
        "plan_duration": size,
        "lead": size,
        "judged": flag,
        "like": text,
        "optional": flag,
    },
)
_CONTROLLER = TableShape(
    {},
    {
        **_VARIED,
        **_SELECTION,
        "design": text,
        "at": _SIZES,
        "specification": named(anything),
        "inertia_margin": _SIZES,
        "plan": named(anything),
        "fastest": named(anything),
        "plants": NAMES,
        "requires": NAMES,
        "guard": flag,
    },
)
_REFERENCE = TableShape({}, {"kind": text, "unit": text})
_SCENARIO = TableShape(
    {},
    {
        **_SELECTION,
        **dict.fromkeys(("duration", "sample_time", "settle", "rest_window", "count_from"), size),
        "noise": flag,
        "quantise": flag,
        "late_samples": whole,
        "start": _SIZES,
        "changes": _EVENTS,
        "disturbances": _EVENTS,
        "faults": listed(named(anything)),
        "references": named(_REFERENCE),
        "optional": flag,
    },
)
_CAUSE = TableShape({}, {"name": text, "text": text, "variation": text})
STUDY = TableShape(
    {},
    {
        "schema": whole,
        "name": text,
        "description": text,
        "plant": TableShape({}, {**_VARIED, "kind": text}),
        "plants": named(
            TableShape(
                {},
                {
                    **_VARIED,
                    "controllers": named(_CONTROLLER),
                    "variations": named(_VARIATION),
                    "scenarios": named(_SCENARIO),
                    "optional": flag,
                },
            )
        ),
        "variations": named(_VARIATION),
        "controllers": named(_CONTROLLER),
        "scenarios": named(_SCENARIO),
        "requirements": listed(
            TableShape(
                {},
                {
                    "metric": text,
                    "limit": number,
                    "unit": text,
                    "kind": text,
                    "hard": flag,
                    "scenario": text,
                    "weight": number,
                    "controllers": NAMES,
                    "variations": NAMES,
                    "plants": NAMES,
                    "step": size,
                },
            )
        ),
        "metrics": NAMES,
        "seeds": listed(whole),
        "linear": TableShape({}, {"angles": listed(size), "points": listed(_SIZES)}),
        "robustness": TableShape(
            {},
            {
                "box": named(listed(size, length=2)),
                "scenarios": NAMES,
                "controllers": NAMES,
                "draws": whole,
                "search": whole,
                "seed": whole,
                "hard": flag,
            },
        ),
        "tolerances": named(
            TableShape({}, {"absolute": size, "relative": number, "better": text, "gates": flag})
        ),
        "report": TableShape(
            {},
            {
                "physical_limit": flag,
                "limit_steps": listed(listed(size, length=2)),
                "limit_variations": NAMES,
                "figures": NAMES,
                "traced": NAMES,
                "limitations": TableShape(
                    {},
                    {
                        "scenario": text,
                        "ladder": listed(listed(text, length=2)),
                        "controllers": NAMES,
                        "ratio": size,
                        "overshoot": size,
                        "notes": NAMES,
                        **dict.fromkeys(("unknown", "neglected", "loop", "design"), _CAUSE),
                    },
                ),
            },
        ),
    },
)
"""Shape of a study file; which keys there are is told when each part is built."""
