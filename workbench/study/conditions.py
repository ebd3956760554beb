"""Under which conditions a study passes: what is required, where, and how it is compared.

A baseline keeps them beside its runs. A looser limit, a removed requirement, another scenario or a
narrower box would turn a worse controller green, so each counts as a change that must be accepted.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError
from workbench.model.units import convert
from workbench.study.study import Box, Demand, Study
from workbench.verification import Scenario, Tolerance
from workbench.verification.metrics import tolerance_of
from workbench.verification.scenario import USUAL_SAMPLES

LONGEST = 100
"""Numbers of a list that are written out."""


@dataclass(frozen=True)
class ConditionChange:
    """A condition that differs from the baseline's.

    Args:
        name: What changed: ``"requirement on rmse in sine"``.
        fails: Whether it must be accepted: all but what only makes the study stricter.
    """

    name: str
    text: str
    fails: bool = True

    def __str__(self) -> str:
        return f"{self.name}: {self.text}"


def conditions(study: Study) -> dict[str, Any]:
    """Return the conditions of a study as plain numbers and words, with the parts of `_PARTS`."""
    several = len(study.cases) > 1
    scenarios = {
        f"{case.name}, {name}" if several else name: _plain(scenario)
        for case in study.cases.values()
        for name, scenario in case.scenarios.items()
    }
    requirements: dict[str, Any] = {}
    for demand in study.demands:
        name, own = _requirement_name(demand), demand.requirement
        while name in requirements:
            name += " (another)"
        requirements[name] = {"limit": _plain(own.limit), "unit": own.unit or "1"}
        requirements[name] |= {"kind": own.kind, "hard": own.hard, "weight": _plain(demand.weight)}
    return {
        "requirements": requirements,
        "scenarios": scenarios,
        "variations": {v.name: _plain(v) for v in study.variations.values()},
        "box": {} if study.box is None else _box(study.box),
        "tolerances": {n: dict(t._asdict()) for n, t in study.tolerances.items()},
        "unjudged": {n: True for n, s in study.selections.items() if not s.judged},
    }


def condition_changes(
    before: Mapping[str, Any], after: Mapping[str, Any]
) -> tuple[ConditionChange, ...]:
    """Return what differs between the conditions of a baseline and those of a study."""
    found: list[ConditionChange] = []
    for part, (what, rule) in _PARTS.items():
        old, new = before.get(part, {}), after.get(part, {})
        for name in dict.fromkeys([*old, *new]):
            own = old.get(name), new.get(name)
            whole = ("new", False) if own[0] is None else ("removed", True)
            alone = None in own and part not in _NEVER_NEW
            told = (whole,) if alone else rule(name, *own)
            found += (ConditionChange(f"{what} {name}".rstrip(), *said) for said in told)
    return tuple(found)


Said = Iterator[tuple[str, bool]]

_NEVER_NEW = ("tolerances", "unjudged")
"""Parts in which what is not told is as usual."""


def _requirement_name(demand: Demand) -> str:
    required = demand.requirement
    name = required.metric
    if demand.step is not None:
        name += f" of steps of {demand.step:.6g}"
    if required.scenario:
        name += f" in {required.scenario}"
    for what, chosen in (
        ("for", demand.controllers),
        ("with", demand.variations),
        ("on", demand.plants),
    ):
        if chosen:
            name += f" {what} {', '.join(sorted(chosen))}"
    return name


def _requirement(_name: str, old: Any, new: Any) -> Said:
    if old["kind"] != new["kind"]:
        yield f"{old['kind']} -> {new['kind']}", True
    try:
        limit = float(convert(new["limit"], new["unit"], old["unit"]))
    except WorkbenchError:
        yield f"limit {old['limit']:g} {old['unit']} -> {new['limit']:g} {new['unit']}", True
    else:
        if not math.isclose(limit, old["limit"], rel_tol=1e-6, abs_tol=1e-15):
            looser = (limit > old["limit"]) == (new["kind"] == "at_most")
            unit = "" if old["unit"] == "1" else f" {old['unit']}"
            way = "looser" if looser else "stricter"
            yield f"limit {old['limit']:.6g} -> {limit:.6g}{unit}, {way}", looser
    if old["hard"] != new["hard"]:
        yield ("hard -> soft", True) if old["hard"] else ("soft -> hard", False)
    if old["weight"] != new["weight"]:
        yield f"weight {old['weight']:g} -> {new['weight']:g}", False


def _box_entry(name: str, old: Any, new: Any) -> Said:
    if type(old) is not type(new):
        yield f"{_short(old)} -> {_short(new)}", True
    elif isinstance(old, dict):
        ends = [(e["low"], e["high"]) for e in (old, new)]
        if ends[0] != ends[1]:
            narrower = ends[1][0] > ends[0][0] or ends[1][1] < ends[0][1]
            texts = [f"{low:.6g} to {high:.6g}" for low, high in ends]
            yield f"{texts[0]} -> {texts[1]}, {'narrower' if narrower else 'wider'}", narrower
    elif isinstance(old, list):
        if set(old) != set(new):
            yield f"{', '.join(old) or 'all'} -> {', '.join(new) or 'all'}", True
    elif old != new:
        yield f"{old} -> {new}", name == "seed" or new < old


def _tolerance(name: str, old: Any, new: Any) -> Said:
    usual = tolerance_of(name)._asdict()
    old, new = (usual if rule is None else {**usual, "typical": 0.0, **rule} for rule in (old, new))
    for key in Tolerance._fields:
        if old[key] != new[key]:
            closer = key in ("absolute", "typical", "relative") and new[key] < old[key]
            stricter = closer or (key in ("gates", "repeats") and new[key])
            yield f"{key} {old[key]} -> {new[key]}", not stricter


def _unjudged(_name: str, old: Any, new: Any) -> Said:
    if bool(old) != bool(new):
        yield ("no longer judged", True) if new else ("judged now", False)


def _other(_name: str, old: Any, new: Any) -> Said:
    for key, before, after in _differences(old, new):
        yield f"{key} {before} -> {after}".strip(), True


_PARTS: dict[str, tuple[str, Callable[[str, Any, Any], Said]]] = {
    "requirements": ("requirement on", _requirement),
    "scenarios": ("scenario", _other),
    "variations": ("variation", _other),
    "box": ("box of", _box_entry),
    "tolerances": ("tolerance of", _tolerance),
    "unjudged": ("judging of", _unjudged),
}
"""Parts of the conditions: the name that a reviewer knows, and what tells how one differs."""


def _differences(old: Any, new: Any, path: str = "") -> Iterator[tuple[str, str, str]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            inner = f"{path} {key}".strip()
            yield from _differences(old.get(key, _NONE), new.get(key, _NONE), inner)
    elif old != new:
        yield path, _short(old), _short(new)


_NONE = "as usual"


def _short(value: Any) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _box(box: Box) -> dict[str, Any]:
    ranges = {
        name: {"low": _plain(low), "high": _plain(high)} for name, (low, high) in box.ranges.items()
    }
    return ranges | {key: _plain(value) for key, value in vars(box).items() if key != "ranges"}


def _plain(value: Any) -> Any:
    """Return frozen data as JSON has it; what has its usual value is left out."""
    if is_dataclass(value) and not isinstance(value, type):
        found = {} if type(value).__module__.startswith("workbench.") else {"kind": _kind(value)}
        if not found and not hasattr(value, "name") and hasattr(value, "sample"):
            found = {"kind": type(value).__name__.lower()}
        for f in fields(value):
            own = getattr(value, f.name)
            usual = f.default_factory() if f.default_factory is not MISSING else f.default
            if isinstance(value, Scenario) and f.name in USUAL_SAMPLES:
                usual = USUAL_SAMPLES[f.name] * value.sample_time
            if f.name not in ("name", "folder") and own != usual:
                found[f.name] = _plain(own)
        return found
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        pairs = [v for v in value if isinstance(v, tuple) and len(v) == 2 and type(v[0]) is str]
        if value and len(pairs) == len(value):
            return {k: _plain(v) for k, v in pairs}
        if len(value) > LONGEST:
            # A recorded trajectory: a change of it must show, and nobody reads its numbers.
            text = json.dumps([_plain(v) for v in value])
            return {"count": len(value), "digest": hashlib.sha256(text.encode()).hexdigest()[:16]}
        return [_plain(v) for v in value]
    if isinstance(value, bool) or value is None or isinstance(value, (int, str)):
        return value
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else str(value)
    if isinstance(value, Path):
        return value.name
    # A reference of the user's own: what it holds, not where it stands in memory.
    held = getattr(value, "__dict__", {})
    return {"kind": _kind(value), **{k: _plain(v) for k, v in held.items()}}


def _kind(value: Any) -> str:
    return f"{type(value).__module__}:{type(value).__qualname__}"
