"""Which cases are made: what each hides, how large, and what was recorded."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from workbench.evaluation.answer_key import Names, read_names
from workbench.evaluation.rig.parameters import EFFECTS, nominal

SIZES = {name: effect.size for name, effect in EFFECTS.items() if effect.size is not None}
"""Sizes by effect; an effect that is either there or not is not in it."""

WRONG_LOAD_KG = 0.8
"""Error of the noted load at the usual size."""


def sizes(effect: str, factor: float) -> dict[str, float]:
    """Return the rig's parameters, in SI, that give an effect another size, relative to its own.

    They are none for an effect that is either there or not.
    """
    size = SIZES.get(effect)
    if size is None:
        return {}
    absent, full = nominal(), EFFECTS[effect].parameters
    return {
        n: full[n] / factor if size.inverse else absent[n] + factor * (full[n] - absent[n])
        for n in (size.main, *size.others)
    }


_PLAN = tomllib.loads(Path(__file__).with_name("plan.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Counterpart:
    """The parameter of the library that states the same size as numbers of the rig.

    Args:
        of: Numbers of the rig, each with its power in their product (dimensionless).
        factor: By what the product is multiplied, in any unit.
        less: What is taken from the product before, in its unit.
        size: Whether it is the parameter whose zero means absent.
    """

    parameter: str
    of: Mapping[str, float]
    factor: float = 1.0
    less: float = 0.0
    size: bool = True

    def true(self, p: Mapping[str, float]) -> float:
        """Return the parameter, in the library's unit, for the rig's numbers, in SI."""
        product = math.prod(float(p[n] ** power) for n, power in self.of.items())
        return self.factor * (product - self.less)


COUNTERPARTS = {
    (effect, name): Counterpart(**entry)
    for effect, entries in _PLAN["counterparts"].items()
    for name, entry in entries.items()
}
"""By effect of the rig and name in the library: where both state the same quantity."""


@cache
def names() -> Names:
    """Return how the rig's words are read."""
    return read_names(Path(__file__).with_name("names.toml"))


OUTSIDE = tuple(name for name in EFFECTS if names().effects[name].outside)
"""Effects of the rig that the library does not have."""

SINGLE = tuple(name for name in EFFECTS if name not in OUTSIDE)
"""Effects of the rig that it has, by other laws in part."""

PAIRS, TRIPLES = (tuple(map(tuple, _PLAN[kind])) for kind in ("pairs", "triples"))

FACTORS = (1.0, 0.4, 2.0)
"""Size over the rig's own, turn by turn."""

LOADS_KG = (1.0, 3.0, 5.0)

POORLY_SEEN: tuple[str, ...] = tuple(_PLAN["poorly_seen"])
"""Effects that something else resembles as long as the arm hardly moves."""

NOISES: Mapping[str, Mapping[str, float]] = _PLAN["noises"]
"""What the sensors may do beside white noise: parameters of the rig, in SI."""

FIRST_SEED = 2000
"""Seed of the first case of the plan. Other thousands give other cases of the same kinds: other
background parameters, loads, excitations and noise."""

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""Multiples of it, less their whole parts, lie evenly however many there are (H. Weyl 1916)."""


@dataclass(frozen=True)
class Planned:
    """A case to be made.

    Args:
        load: Mass of the plates as noted, in kg.
        kind: ``single``, ``pair``, ``triple``, ``nothing``, ``outside``, or ``limited`` where the
            recordings are closed-loop only.
        factor: Size relative to the rig's own.
        spread: How far the background parameters leave their nominal values, relative to their
            usual range.
        recorded: What is recorded, as `workbench.evaluation.rig.cases.make_case` takes it.
        changes: Parameters of the rig that are set, in SI.
        load_error: What the rig carries beyond the noted load, in kg.
    """

    seed: int
    effects: tuple[str, ...]
    load: float
    kind: str
    factor: float = 1.0
    spread: float = 1.0
    recorded: str = "all"
    changes: dict[str, float] = field(default_factory=dict)
    load_error: float = 0.0

    @property
    def name(self) -> str:
        """Name of the case."""
        return f"own-{self.seed}"

    @property
    def title(self) -> str:
        """What it hides, in a few words."""
        hidden = "+".join(self.effects) or "nothing"
        size = f" x{self.factor:g}" if any(e in SIZES for e in self.effects) else ""
        extra = [] if self.recorded == "all" else [self.recorded]
        extra += [
            words for words, changes in NOISES.items() if changes.items() <= self.changes.items()
        ]
        return hidden + size + (f" ({', '.join(extra)})" if extra else "")


@dataclass(frozen=True)
class _Item:
    effects: Sequence[str]
    kind: str
    recorded: str = "all"
    noise: str = ""


_NOTHING = 12
"""Cases of each turn that hide nothing."""


def plan(first_seed: int | None = None) -> tuple[Planned, ...]:
    """Return three turns of cases, each determined by its seed, in the order in which they are run.

    Each turn has every single effect at one size, some of the pairs, triples and effects outside
    the library, some special cases and one in six with nothing hidden, spread so that any
    beginning of the plan is a fair sample.

    Args:
        first_seed: Seed of the first case, a multiple of 1000; None for `FIRST_SEED`.
    """
    first = FIRST_SEED if first_seed is None else first_seed
    cases: list[Planned] = []
    for turn, factor in enumerate(FACTORS):
        single = [name for name in SINGLE if turn == 0 or name in SIZES or name == "wrong_load"]
        pairs = (PAIRS[:3], PAIRS[3:], PAIRS)[turn]
        hidden = [_Item((name,), "single") for name in single]
        hidden += [_Item(pair, "pair") for pair in pairs]
        hidden += [_Item(names, "triple") for names in TRIPLES[turn::3]]
        hidden += [_Item((name,), "outside") for name in OUTSIDE[turn::3]]
        hidden += [_Item(**item) for item in _PLAN["special"][turn]]
        noises = [""] * (_NOTHING - len(NOISES)) + list(NOISES)
        nothing = [_Item((), "nothing", noise=noise) for noise in noises]
        placed = 0
        for k, item in enumerate(_spread(hidden)):
            cases.append(_planned(first, len(cases), item, factor))
            if (k + 1) * _NOTHING >= (placed + 1) * len(hidden):
                even = placed % 2 == 0
                cases.append(_planned(first, len(cases), nothing[placed], 1.0, even=even))
                placed += 1
    return tuple(cases)


def _spread(items: list[_Item]) -> list[_Item]:
    """Visit muscles, joint, valve, air and sensors in turn, evenly from any beginning on."""
    return [items[i] for i in sorted(range(len(items)), key=lambda i: i * _GOLDEN % 1.0)]


def _planned(
    first_seed: int, number: int, item: _Item, factor: float, *, even: bool = False
) -> Planned:
    """Give an item its seed, load and sizes; `even` keeps the background nominal."""
    # Several effects at once, those outside the library and limited recordings stay at the rig's
    # own size.
    factor = factor if item.kind == "single" and not item.noise else 1.0
    changes = {n: v for e in item.effects for n, v in sizes(e, factor).items()}
    changes |= NOISES.get(item.noise, {})
    # The same kind of case has another load and the other sign in the next thousand.
    turned = number + (first_seed - FIRST_SEED) // 1000
    sign = 1.0 if turned % 2 else -1.0
    return Planned(
        first_seed + number,
        tuple(item.effects),
        LOADS_KG[turned % len(LOADS_KG)],
        item.kind,
        factor,
        (0.0 if even else 2.0) if not item.effects else 1.0,
        item.recorded,
        changes,
        sign * factor * WRONG_LOAD_KG if "wrong_load" in item.effects else 0.0,
    )
