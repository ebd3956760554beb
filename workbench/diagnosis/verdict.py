"""The verdict on a case: what is missing, where, how large, how sure, and what cannot be told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from workbench.computing.counted import Work
from workbench.diagnosis.location.missing_signal import Occurrence
from workbench.diagnosis.selection.weights import Weighted
from workbench.display import Rows, Shown
from workbench.errors import WorkbenchError
from workbench.files import json_text, picked, plain
from workbench.model import Model
from workbench.model.units import (
    of_difference,
    parse_unit,
    read_with_deviation,
    time_unit,
    written_unit,
)

SCHEMA = "workbench.verdict/2"

_SCHEMA_1 = "workbench.verdict/1"

AWAY = 1e9
"""Error over the noise beyond which a run is nowhere, and its number tells nothing."""

Kind = Literal[
    "data_unfit",
    "nothing_missing",
    "parameter",
    "likely",
    "sensor",
    "named",
    "named_class",
    "located_unnamed",
    "unexplained",
]


Belief = Literal["sure", "likely"]


@dataclass(frozen=True)
class Value:
    """A number with its unit and standard deviation.

    Args:
        value: The number, in ``unit``.
        std: Standard deviation, in ``unit``.
        shown: Unit in which people read it; empty for ``unit``.
    """

    value: float
    unit: str
    std: float
    shown: str = ""

    @property
    def read(self) -> tuple[float, float, str]:
        """Number, standard deviation and unit as people read them."""
        told = read_with_deviation(self.value, self.std, self.unit, self.shown)
        if told[-1] == "s":
            unit, size = time_unit(self.value)
            return self.value / size, self.std / size, unit
        return told


@dataclass(frozen=True)
class Finding:
    """A piece of physics that the model lacks.

    Args:
        where: Port names, the most likely group first.
        effect: Name in the library, ``"nonparametric"``, or None.
        alike: Effects that these data cannot separate, the named one first.
        excess_explained: Fraction of the error beyond the noise that the effect removes on
            held-out recordings, 0 to 1.
        gain: Log likelihood gained on the fitting recordings, dimensionless.
        p_value: Probability of such a gain on held-out recordings by chance.
        held_out: Log likelihood gained on held-out recordings with its 99 % interval,
            dimensionless.
        weight: Weight of all sets of effects that contain it or one of ``alike``, 0 to 1,
            dimensionless; NaN if none was compared.
        belief: Whether every rule agrees with it, or only the recordings do.
        doubts: Rules that speak against it, in words.
        occurrence: When, with which local signal and where it acts; None if that is not known.
        or_value: Whether a wrong value that no refit changes would do the same.
    """

    where: tuple[str, ...]
    effect: str | None
    alike: tuple[str, ...]
    sentence: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    excess_explained: float = math.nan
    gain: float = math.nan
    p_value: float = math.nan
    held_out: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    weight: float = math.nan
    belief: Belief = "sure"
    doubts: tuple[str, ...] = ()
    occurrence: Occurrence | None = None
    or_value: bool = False


@dataclass(frozen=True, repr=False)
class Verdict(Shown):
    """What a diagnosis found.

    Args:
        findings: What is missing, the most important first.
        fit: Held-out errors by model (``nominal``, ``refitted``, ``extended``, ``noise_floor``)
            and output, in SI.
        improved: Parameters of the improved model; empty where nothing was found.
        not_testable: Effects that these data could not have shown, with the reason.
        refused: Effects that were refused, taken back or could not be tried, with rule and reason.
        weights: The likeliest sets of effects that were compared, with their weights, see
            `set_weights`; the empty set is the refitted nominal model.
        next_experiment: What to do next, with the predicted separation.
        location: Log likelihood gained by an unknown input at each group of ports, before and
            after the extension, dimensionless.
        seconds: Time that the diagnosis took, in s.
        occurrence: When and where predictions are wrong, if something is missing that could not be
            located; None otherwise.
        interrupted: Whether the diagnosis was ended early, by an interruption or a time limit.
        model: The improved model; the refitted nominal one where nothing was found.
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
    refused: tuple[Mapping[str, Any], ...] = ()
    weights: tuple[Weighted, ...] = ()
    next_experiment: Mapping[str, Any] = field(default_factory=dict)
    data: tuple[Mapping[str, str], ...] = ()
    location: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    seconds: float = math.nan
    work: Work = field(default_factory=dict)
    interrupted: bool = False
    occurrence: Occurrence | None = None

    @property
    def brief(self) -> str:
        """Kind and names in one line: ``named_class: coulomb_friction or stribeck_friction``."""
        said = [" or ".join(f.alike) or f"something at {', '.join(f.where)}" for f in self.findings]
        return f"{self.kind}: {', '.join(said)}" if said else self.kind

    def as_data(self) -> dict[str, Any]:
        """Return the verdict as plain data; numbers that are not finite become None."""
        findings = [
            picked(f, "where effect class=alike belief doubts sentence")
            | {"parameters": {k: picked(v, "value unit std") for k, v in f.parameters.items()}}
            | picked(f, "excess_explained log_likelihood_gain=gain held_out_gain=held_out p_value")
            | {"weight": f.weight, "occurrence": f.occurrence and f.occurrence.as_data()}
            for f in self.findings
        ]
        data: dict[str, Any] = plain(
            {"schema": SCHEMA, "verdict": self.kind, "sentence": self.sentence}
            | {"findings": findings, "fit": {"held_out": self.fit, "units": self.units}}
            | picked(self, "parameters improved_parameters=improved not_testable refused")
            | {"weights": [picked(w, "effects weight") for w in self.weights]}
            | picked(self, "next_experiment data location seconds work")
            | ({"occurrence": self.occurrence.as_data()} if self.occurrence else {})
            | ({"interrupted": True} if self.interrupted else {})
        )
        return data

    def to_json(self, plant: Mapping[str, Any] | None = None) -> str:
        """Return the verdict as text for ``verdict.json``.

        Args:
            plant: The verdict's model as `workbench.plants.registry.saved_plant` writes it, by
                which verbs and studies take the file as a plant.
        """
        return json_text(self.as_data() | ({"plant": plant} if plant else {}))

    def tables(self) -> tuple[Rows, ...]:
        """Return the errors on held-out recordings and what was found."""
        names = list(self.units)
        fit = [
            (label, *(errors.get(n, math.nan) for n in names)) for label, errors in self.fit.items()
        ]
        found = [
            (", ".join(f.where), f.effect or "no name", f.belief, name, *v.read)
            for f in self.findings
            for name, v in (f.parameters or {"": Value(math.nan, "", math.nan)}).items()
        ]
        heads = ("where", "effect", "belief", "parameter", "value", "deviation", "unit")
        units = (f"{n} in {self.units[n]}" for n in names)
        return (
            Rows("rms error on held-out recordings", ("model", *units), fit),
            Rows("what was left out", heads, found),
        )

    def __str__(self) -> str:
        lines = [f"{self.kind}: {self.sentence}"]
        for finding in self.findings:
            if finding.sentence not in self.sentence:
                lines.append(f"  {finding.sentence}")
            own = f"{finding.effect}." if len(self.findings) > 1 else ""
            lines += [
                f"    {own + name:<34} {value:>11.4g} +- {std:<9.2g} {written_unit(unit)}".rstrip()
                for name, v in finding.parameters.items()
                for value, std, unit in (v.read,)
            ]
        if self.fit:
            shown = {q.name: of_difference(q.display_unit) for q in self.model.outputs}
            units = {n: shown.get(n, unit) for n, unit in self.units.items()}
            heads = {n: f"{n} in {written_unit(u)}" if u != "1" else n for n, u in units.items()}
            wide = max(20, *(2 + len(head) for head in heads.values()))
            lines.append("  held-out rms; refitted and extended: with parameters that run closest")
            lines.append(f"{'':15}" + "".join(f"{head:>{wide}}" for head in heads.values()))
            lines += [
                f"    {label:<11}"
                + "".join(f"{self._told(errors, n, u):>{wide}}" for n, u in units.items())
                for label, errors in self.fit.items()
            ]
        if len(self.weights) > 1:
            told = (f"{w} {w.weight:.2f}" for w in self.weights)
            lines.append(f"  likeliest sets of effects: {', '.join(told)}")
        if sentence := self.next_experiment.get("sentence"):
            lines.append(f"  next: {sentence}")
        return "\n".join(lines)

    def _told(self, errors: Mapping[str, float], name: str, unit: str) -> str:
        """Return the error of an output in a unit, or that the model does not stay near it."""
        error, noise = errors.get(name, math.nan), self.fit.get("noise_floor", {}).get(name, 0.0)
        off = noise > 0.0 and error > AWAY * noise
        return "runs away" if off else f"{error / parse_unit(unit).factor:.4g}"


def upgraded(data: Mapping[str, Any], source: str = "the verdict") -> dict[str, Any]:
    """Return the data of a ``verdict.json`` of any schema in the words of the present one.

    Args:
        source: Where they come from, for the error.

    Raises:
        WorkbenchError: If they are no verdict of a known schema.

    Example:
        >>> old = {"schema": "workbench.verdict/1", "verdict": "located_unnamed"}
        >>> upgraded(old | {"findings": [{"effect": "free_form"}]})["findings"]
        [{'belief': 'sure', 'effect': 'nonparametric'}]
    """
    schema = data.get("schema")
    if schema not in (SCHEMA, _SCHEMA_1) or not isinstance(data.get("verdict"), str):
        raise WorkbenchError(
            f"{source} has the schema {schema!r}; it must be {SCHEMA!r} or {_SCHEMA_1!r}"
        )
    if schema == SCHEMA:
        return dict(data)
    words = {"share_of_excess_explained": "excess_explained"}
    findings = [
        {"belief": "sure"} | {words.get(key, key): value for key, value in finding.items()}
        for finding in data.get("findings") or ()
    ]
    for finding in findings:
        for key in ("effect", "class"):
            if key in finding:
                finding[key] = _renamed(finding[key])
    return dict(data) | {"schema": SCHEMA, "findings": findings}


def _renamed(value: Any) -> Any:
    if isinstance(value, list):
        return [_renamed(v) for v in value]
    return "nonparametric" if value == "free_form" else value
