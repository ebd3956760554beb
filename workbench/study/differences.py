"""Machines that differ from what a design knows: by one thing in turn, or by three.

What may differ follows from what a plant declares: laws of the library that machines usually have
some of, at every place that they fit, parameters or what it tolerates of them, options, and the
noise of sensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np

from workbench.errors import WorkbenchError
from workbench.model import Parameter
from workbench.model.units import in_time, parse_unit, same_dimension
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.library import library
from workbench.study.plants import PlantRecipe
from workbench.study.study import Demand, Study, Variation
from workbench.verification import Requirement, Scenario, Steps

BLIND_SEED = 31_416
"""Seed of draws that no design was tuned with."""

USUAL = 0.2
"""Part of its value by which a number usually differs that says no more, a ratio."""

K = TypeVar("K")


@dataclass(frozen=True)
class Difference:
    """Something that may differ of a machine.

    Args:
        name: What it is: a law at a place, a parameter, an option.
        kind: What several are one of: the law.
        made: Returns a machine with it, for a size over the usual one and for the place of its
            shape among those worth trying, both ratios.
        signed: Whether its size may have either sign.
    """

    name: str
    kind: str
    made: Callable[[PlantRecipe, float, float], PlantRecipe]
    signed: bool = True

    def drawn(self, machine: PlantRecipe, rng: np.random.Generator) -> PlantRecipe:
        """Return a machine with it at up to its usual size."""
        size = rng.uniform(-1.0 if self.signed else 0.0, 1.0)
        return self.made(machine, size, rng.uniform())


def differences(
    machine: PlantRecipe, controlled: Iterable[str], sample_time: float
) -> tuple[Difference, ...]:
    """Return what may differ of a machine.

    Args:
        controlled: Outputs that follow a reference: what falsifies them at rest no loop can see.
        sample_time: Sample time of the loop, in s, of which usual delays and lags are some.
    """
    model, plant = machine.build(), machine.plant()
    followed = {f"{name}.reading" for name in controlled}
    # Where it is not sampled finely a delay of many samples is none that is usual.
    fine = sample_time if sample_time < model.horizon / 500.0 else 0.0
    laws = [
        _law(h)
        for h in library(model, sample_time=fine)
        if h.usual and not (followed & set(h.ports) and (h.effect.dry or not h.effect.states))
    ]
    known = {q.name: q for q in model.parameters}
    ends = plant.tolerated or {n: own for n, q in known.items() if any(own := _spread(q))}
    parameters = [_parameter(known[name], low, high) for name, (low, high) in ends.items()]
    options = [
        _option(o.name, float(dict(machine.options).get(o.name, o.default)), o.lower, o.upper)
        for o in plant.options
        if isinstance(o.default, float) and o.name not in known and not plant.tolerated
    ]
    noisy = any(q.noise_rms for q in model.outputs)
    noise = Difference("noise", "noise", lambda m, k, _: m.varied(noise=1.0 + k), signed=False)
    return (*laws, *parameters, *options, *([noise] if noisy else []))


def _law(law: Hypothesis) -> Difference:
    def made(machine: PlantRecipe, part: float, shape: float) -> PlantRecipe:
        chosen = law.shapes[min(int(shape * len(law.shapes)), len(law.shapes) - 1)]
        size = 1.0 if law.whole or law.replaces else part * law.typical_size
        size = min(max(size, law.size.lower), law.size.upper)
        values = {**chosen, law.size_parameter: size}.items()
        own = [(f"{law.name}.{name}", value) for name, value in values]
        return machine.varied(effects=[law.name], parameters=own)

    return Difference(law.name, law.law, made, law.size.lower <= -law.typical_size)


def _parameter(about: Parameter, low: float, high: float) -> Difference:
    def made(machine: PlantRecipe, part: float, _: float) -> PlantRecipe:
        value = about.value + abs(part) * (high if part > 0.0 else low)
        value = min(max(value, about.lower), about.upper)
        return machine.varied(parameters=[(about.name, value)])

    return Difference(about.name, about.name, made)


def _spread(q: Parameter) -> tuple[float, float]:
    """Return by how much a parameter may be less and more, in SI; zeros if not at all."""
    # A temperature has no part of itself; gravity is known; an effect's shape is the law's matter.
    gravity = parse_unit("gn")
    known = same_dimension(q.unit, "gn") and math.isclose(q.value, gravity.factor, rel_tol=0.01)
    known = known or same_dimension(q.unit, "K") or "." in q.name
    size = 0.0 if known else USUAL * abs(q.value)
    return -size, size


def _option(name: str, value: float, lower: float, upper: float) -> Difference:
    def made(machine: PlantRecipe, part: float, _: float) -> PlantRecipe:
        other = min(max(value * (1.0 + USUAL * part), lower), upper)
        return machine.varied(options=[(name, other)])

    return Difference(name, name, made)


def each(machine: PlantRecipe, found: Sequence[Difference]) -> Iterator[Variation]:
    """Yield a machine with each difference alone, at its usual size and its usual shape."""
    for one in found:
        for sign in (-1.0, 1.0) if one.signed else (1.0,):
            name = f"{one.name}{'' if not one.signed else ' less' if sign < 0.0 else ' more'}"
            name = name.replace("_", " ")
            yield Variation(name, one.made(machine, sign, 0.0), kind=name, differs=(one.kind,))


def in_turn(names: Sequence[K], count: int, rng: np.random.Generator) -> Iterator[list[K]]:
    """Yield what machines differ by: one kind in turn, or, every second time, three at random."""
    for i in range(count):
        if i % 2 == 0:
            yield [names[(i // 2) % len(names)]]
        else:
            yield [names[k] for k in rng.choice(len(names), min(3, len(names)), replace=False)]


def drawn(
    machine: PlantRecipe, found: Sequence[Difference], count: int, seed: int = BLIND_SEED
) -> Iterator[Variation]:
    """Yield drawn machines; the same ones for the same seed."""
    kinds: dict[str, list[Difference]] = {}
    for one in found:
        kinds.setdefault(one.kind, []).append(one)
    rng = np.random.default_rng(seed)
    for i, chosen in enumerate(in_turn(list(kinds), count, rng)):
        recipe = machine
        for kind in chosen:
            own = kinds[kind]
            with suppress(WorkbenchError):
                # What excludes another, as a lag of a delayed sensor, is left out.
                further = own[rng.integers(len(own))].drawn(recipe, rng)
                further.build()
                recipe = further
        name = f"machine {i + 1:0{len(str(count))}d}"
        yield Variation(name, recipe, kind=name, differs=tuple(chosen))


def on_machines(study: Study, machines: Iterable[Variation]) -> Study:
    """Return a study of steps on machines too; where it demands nothing, each step must settle.

    It must before the next one; to miss that fails no study.
    """
    demands = study.demands or tuple(
        Demand(_settled(name, signal, scenario, len(scenario.references) > 1))
        for scenario in study.scenarios.values()
        for name, signal in scenario.references.items()
        if isinstance(signal, Steps) and signal.changes
    )
    every = {**study.variations, **{one.name: one for one in machines}}
    return replace(study, variations=every, demands=demands)


def _settled(name: str, signal: Steps, scenario: Scenario, several: bool) -> Requirement:
    times = [change[0] for change in signal.changes]
    longest = max(after - before for before, after in pairwise((*times, scenario.duration)))
    value, unit = in_time(longest).split()
    metric = f"{name}.settling_time" if several else "settling_time"
    where = scenario.name if several else ""
    return Requirement(metric, float(value), unit, hard=False, scenario=where)
