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
from workbench.linearisation import linearise
from workbench.model import Parameter
from workbench.model.units import in_time, parse_unit, same_dimension, with_unit
from workbench.operating_point import operating_point
from workbench.operating_point.operating_point import GROWS
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.survey import Survey
from workbench.plants.plant import Option
from workbench.study.plants import PlantRecipe
from workbench.study.study import Demand, Study, Variation
from workbench.study.summary import parameter_text
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
        told: Returns the size in words, for one over the usual one, a ratio.
        signed: Whether its size may have either sign.
    """

    name: str
    kind: str
    made: Callable[[PlantRecipe, float, float], PlantRecipe]
    told: Callable[[float], str]
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
    # A loop that samples coarsely has no delays of as many samples.
    usual = Survey(model).place(model.ports[0].name).interval
    fitting = [
        h
        for h in library(model, RecordedFacts(sample_time=min(sample_time, usual)))
        if h.usual and not (followed & set(h.ports) and (h.effect.dry or not h.effect.states))
    ]
    calm = not _grows(machine)
    # A machine that runs away by itself is none that anybody has, as a coil whose own drop is late.
    laws = [
        law
        for h in fitting
        if (law := _law(h)) and not (calm and h.effect.states and _grows(law.made(machine, 1, 0)))
    ]
    known = {q.name: q for q in model.parameters}
    ends = plant.tolerated or {n: own for n, q in known.items() if any(own := _spread(q))}
    parameters = [_parameter(known[name], low, high) for name, (low, high) in ends.items()]
    options = [
        _option(o, float(dict(machine.options).get(o.name, o.default)))
        for o in plant.options
        if isinstance(o.default, float) and o.name not in known and not plant.tolerated
    ]
    noisy = any(q.noise_rms for q in model.outputs)
    noise = Difference(
        "noise",
        "noise",
        lambda machine, part, _: machine.varied(noise=1.0 + part),
        lambda part: f"x {1.0 + part:.3g}",
        signed=False,
    )
    return (*laws, *parameters, *options, *([noise] if noisy else []))


def _grows(machine: PlantRecipe) -> bool:
    """Tell whether a machine that rests runs away by itself; of one that does not, no."""
    with suppress(WorkbenchError):
        poles = linearise(operating_point(machine.build()), verdict=False).poles
        return bool(np.any(poles.real > GROWS * np.abs(poles).max(initial=0.0)))
    return False


def _law(law: Hypothesis) -> Difference:
    def size(part: float) -> float:
        found = 1.0 if law.whole or law.replaces else part * law.typical_size
        return min(max(found, law.size.lower), law.size.upper)

    def made(machine: PlantRecipe, part: float, shape: float) -> PlantRecipe:
        chosen = law.shapes[min(int(shape * len(law.shapes)), len(law.shapes) - 1)]
        values = {**chosen, law.size_parameter: size(part)}.items()
        own = [(f"{law.name}.{name}", value) for name, value in values]
        return machine.varied(effects=[law.name], parameters=own)

    signed = law.size.lower <= -law.typical_size
    return Difference(
        law.name, law.law, made, lambda part: parameter_text(size(part), law.unit), signed
    )


def _parameter(about: Parameter, low: float, high: float) -> Difference:
    def value(part: float) -> float:
        moved = about.value + abs(part) * (high if part > 0.0 else low)
        return min(max(moved, about.lower), about.upper)

    return Difference(
        about.name,
        about.name,
        lambda machine, part, _: machine.varied(parameters=[(about.name, value(part))]),
        lambda part: parameter_text(value(part), about.unit),
    )


def _spread(q: Parameter) -> tuple[float, float]:
    """Return by how much a parameter may be less and more, in SI; zeros if not at all."""
    # A temperature has no part of itself; gravity is known; an effect's shape is the law's matter.
    gravity = parse_unit("gn")
    known = same_dimension(q.unit, "gn") and math.isclose(q.value, gravity.factor, rel_tol=0.01)
    known = known or same_dimension(q.unit, "K") or "." in q.name
    size = 0.0 if known else USUAL * abs(q.value)
    return -size, size


def _option(about: Option, usual: float) -> Difference:
    def value(part: float) -> float:
        return min(max(usual * (1.0 + USUAL * part), about.lower), about.upper)

    return Difference(
        about.name,
        about.name,
        lambda machine, part, _: machine.varied(options=[(about.name, value(part))]),
        lambda part: with_unit(f"{value(part):.3g}", about.unit or "1"),
    )


def each(machine: PlantRecipe, found: Sequence[Difference]) -> Iterator[Variation]:
    """Yield a machine with each difference alone, at its usual size and its usual shape."""
    for one in found:
        for sign in (-1.0, 1.0) if one.signed else (1.0,):
            name = f"{one.name.replace('_', ' ')} {one.told(sign)}"
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
