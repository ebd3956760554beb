"""The verdict on a case: what is missing, where, how large, how sure, and what cannot be told."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from workbench.model import Model

SCHEMA = "workbench.verdict/1"

Kind = Literal[
    "data_unfit",
    "nothing_missing",
    "parameter",
    "sensor",
    "named",
    "named_class",
    "located_unnamed",
    "unexplained",
]


@dataclass(frozen=True)
class Value:
    """A number with its unit and standard deviation.

    Args:
        value: The number, in ``unit``.
        unit: SI unit.
        std: Standard deviation, in ``unit``.

    Example:
        >>> Value(1.2, "N m", 0.05).unit
        'N m'
    """

    value: float
    unit: str
    std: float


@dataclass(frozen=True)
class Finding:
    """A piece of physics that the model lacks.

    Args:
        where: Port names, the most likely group first.
        effect: Name in the library, ``"free_form"``, or None.
        alike: Effects that these data cannot separate, the named one first.
        sentence: One plain sentence.
        parameters: Own parameters of the effect, by name.
        share_of_excess_explained: Fraction of the error beyond the noise that the effect removes
            on held-out recordings, 0 to 1.
        gain: Log likelihood gained on the fitting recordings, dimensionless.
        p_value: Probability of such a gain on held-out recordings by chance.

    Example:
        >>> Finding(("joint.torque",), "tilt_gravity", ("tilt_gravity",), "tilted").effect
        'tilt_gravity'
    """

    where: tuple[str, ...]
    effect: str | None
    alike: tuple[str, ...]
    sentence: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    share_of_excess_explained: float = math.nan
    gain: float = math.nan
    p_value: float = math.nan


@dataclass(frozen=True)
class Verdict:
    """What a diagnosis found.

    Args:
        kind: The verdict in one word.
        sentence: The verdict in one sentence.
        findings: What is missing, the most important first.
        fit: Held-out errors by model (``nominal``, ``refitted``, ``extended``, ``noise_floor``)
            and output, in SI.
        units: Units of ``fit`` by output.
        parameters: Parameters of the refitted nominal model.
        improved: Parameters of the improved model; empty where nothing was found.
        not_testable: Effects that these data could not have shown, with the reason.
        next_experiment: What to do next, with the predicted separation.
        data: Checks of the recordings.
        location: Log likelihood gained by an unknown input at each group of ports, before and
            after the extension, dimensionless.
        seconds: Time that the diagnosis took, in s.
        model: The improved model; the refitted nominal one where nothing was found.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> verdict = Verdict("nothing_missing", "Nothing is missing.", model=servo_axis())
        >>> print(verdict)
        nothing_missing: Nothing is missing.
    """

    kind: Kind
    sentence: str
    model: Model
    findings: tuple[Finding, ...] = ()
    fit: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    improved: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    not_testable: tuple[Mapping[str, str], ...] = ()
    next_experiment: Mapping[str, Any] = field(default_factory=dict)
    data: tuple[Mapping[str, str], ...] = ()
    location: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    seconds: float = math.nan

    def as_data(self) -> dict[str, Any]:
        """Return the verdict as plain data; numbers that are not finite become None."""
        data: dict[str, Any] = _plain(
            {
                "schema": SCHEMA,
                "verdict": self.kind,
                "sentence": self.sentence,
                "findings": [
                    {
                        "where": list(f.where),
                        "effect": f.effect,
                        "class": list(f.alike),
                        "sentence": f.sentence,
                        "parameters": {
                            k: {"value": v.value, "unit": v.unit, "std": v.std}
                            for k, v in f.parameters.items()
                        },
                        "share_of_excess_explained": f.share_of_excess_explained,
                        "log_likelihood_gain": f.gain,
                        "p_value": f.p_value,
                    }
                    for f in self.findings
                ],
                "fit": {"held_out": self.fit, "units": self.units},
                "parameters": self.parameters,
                "improved_parameters": self.improved,
                "not_testable": list(self.not_testable),
                "next_experiment": self.next_experiment,
                "data": list(self.data),
                "location": self.location,
                "seconds": self.seconds,
            }
        )
        return data

    def to_json(self) -> str:
        """Return the verdict as text for ``verdict.json``."""
        return json.dumps(self.as_data(), indent=2, ensure_ascii=False) + "\n"

    def __str__(self) -> str:
        """Return the verdict, its findings and the held-out errors as a short aligned table."""
        lines = [f"{self.kind}: {self.sentence}"]
        for finding in self.findings:
            lines.append(f"  {finding.sentence}")
            lines += [
                f"    {name:<34} {v.value:>11.4g} +- {v.std:<9.2g} {v.unit}"
                for name, v in finding.parameters.items()
            ]
        if self.fit:
            names = list(self.units)
            lines.append(
                "  held out     " + "".join(f"{n + ' ' + self.units[n]:>20}" for n in names)
            )
            lines += [
                f"    {label:<11}" + "".join(f"{errors.get(n, math.nan):>20.4g}" for n in names)
                for label, errors in self.fit.items()
            ]
        if self.next_experiment:
            lines.append(f"  next: {self.next_experiment.get('sentence', '')}")
        return "\n".join(lines)


def _plain(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {str(k): _plain(v) for k, v in data.items()}
    if isinstance(data, (list, tuple)):
        return [_plain(v) for v in data]
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    return data
