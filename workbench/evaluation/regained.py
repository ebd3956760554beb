"""Speed that tolerating an unknown machine costs, and what a diagnosis of it gives back.

Three designs of each family step alike: the nominal one on the nominal plant, the tolerant one on
the machine that was found, and on that machine again the nominal design made anew: from the model
with all that was found, predicting over the latency and the lags in it, which it holds its margins
for within half a millisecond. Nothing but what is known differs between the first and the last.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.joint.hysteresis_compensation import with_compensation
from controllers.joint.model import lag_beside
from controllers.joint.tracking import TrackingSpecification
from controllers.uncertainty import Uncertainty
from workbench.diagnosis.redesign import found_lags
from workbench.errors import check_choice
from workbench.evaluation.tolerance import measured, tolerant_study
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.plants.plant import Plant
from workbench.simulation import simulate
from workbench.study.designs import ControllerRecipe
from workbench.study.plants import PlantRecipe
from workbench.study.schema import load_study, shipped_study
from workbench.verification import Steps, verify

PRESSURE_FILTER = 0.002
"""Time constant of the filter of the pressures, by which feedforward leads too, in s."""

CASE = "3 kg horizontal"
"""Case of the study 'controllers' whose rules are those of the nominal designs."""


@dataclass(frozen=True)
class DesignRun:
    """A design on a plant along the steps of the tolerant study.

    Args:
        speed: The number for its speed, in rad/s.
        limit: What the next faster design misses.
        time: Sample times, shape (n,), in s.
        angle: True angle, shape (n,), in rad.
    """

    family: str
    which: str
    speed: float
    limit: str
    controller: Any
    told: dict[str, Any]
    time: NDArray[np.float64]
    angle: NDArray[np.float64]


WHICH = ("nominal, on the nominal plant", "tolerant, on the machine", "redesigned, on the machine")


def nominal_recipe(family: str, plant: PlantRecipe) -> ControllerRecipe:
    """Return the nominal design of a family for a plant without latency.

    Raises:
        WorkbenchError: If there is no such family.
    """
    own = load_study(shipped_study("controllers")).cases[CASE].controllers
    names = [name for name in tolerant_study().controllers if name in own]
    recipe = own[check_choice("controller", family, names)]
    assert recipe.fastest is not None
    smooth = plant.varied(without=plant.build().dry_effects)
    fastest = replace(
        recipe.fastest,
        plants=tuple(smooth.varied(parameters=p.parameters) for p in recipe.fastest.plants),
    )
    return replace(recipe, plant=smooth, fastest=fastest)


def nominal_plant(machine: PlantRecipe) -> PlantRecipe:
    """Return the plant of the tolerant study with the options of a machine."""
    options = {o.name: o.default for o in machine.plant().options}
    return tolerant_study().plant.varied(options={**options, **dict(machine.options)}.items())


def redesigned(family: str, machine: PlantRecipe) -> tuple[Any, float, str]:
    """Make the nominal design of a family anew from what was found of a machine.

    Returns:
        Controller, its speed in rad/s, and what the next faster one misses.

    Raises:
        WorkbenchError: If no speed holds the margins.
    """
    model = machine.build()
    found = found_lags(model)
    recipe = nominal_recipe(family, machine.varied(without=tuple(found)))
    assert recipe.fastest is not None
    late = [time for what, time in found.values() if what == "latency"]
    slow = [time for what, time in found.values() if what == "sensor_lag"]
    h = TrackingSpecification().sample_time
    beside = float(np.median([lag_beside(recipe.linear(at)) for at in recipe.fastest.at])) + 0.5 * h
    wanted = {"lead": beside + PRESSURE_FILTER, "lag": beside}
    keys = {key.name for key in recipe.kind().keys}
    told = {**dict(recipe.specification), **{k: v for k, v in wanted.items() if k in keys}}
    unsure = Uncertainty.known(sum(late), sensor_lag=max(slow, default=0.0))
    # A plan asks of the valve what reaches the muscles.
    told["jerk_share"] *= flow_share(model, nominal_plant(machine).build(), machine.plant())
    made = replace(
        recipe,
        specification=tuple(told.items()),
        inertia_margin=(),
        fastest=replace(
            recipe.fastest,
            plants=recipe.fastest.plants[:1],
            late_sensitivity=math.inf,
            maximum_sensitivity=2.2,
            maximum_complementary=2.0,
            uncertainty=unsure,
        ),
    ).designed()
    return with_compensation(made.controller, model), made.speed, made.limit


def flow_share(machine: Model, nominal: Model, plant: Plant) -> float:
    """Return how fast the fully open valve drives the joint through what is between them.

    Returns:
        Largest rate of the pressure difference after the valve opens, relative to that of the
        nominal model, a ratio of at most 1.
    """
    rates = []
    for model in (nominal, machine):
        smooth = model.without(*model.dry_effects)
        rest = operating_point(smooth, plant.design_point)
        run = simulate(smooth, np.full(40, 10.0), sample_time=0.002, start=rest.x, check=False)
        rates.append(float(np.max(np.diff(run["pressure_1"] - run["pressure_2"]))))
    return min(1.0, rates[1] / rates[0])


def regained(machine: PlantRecipe, families: Sequence[str] = ()) -> Iterator[DesignRun]:
    """Run the three designs of each family.

    Args:
        families: Controllers of the study 'tolerant'; by default all.
    """
    study = tolerant_study()
    nominal = nominal_plant(machine)
    (scenario,) = study.scenarios.values()
    signal = scenario.references["angle"]
    assert isinstance(signal, Steps)
    for family in families or study.controllers:
        made = nominal_recipe(family, nominal).designed(), study.controllers[family].designed()
        laws = [(m.controller, m.speed, m.limit) for m in made] + [redesigned(family, machine)]
        for which, plant, (law, speed, limit) in zip(
            WHICH, (nominal, machine, machine), laws, strict=True
        ):
            run = verify(law, plant.build(), scenario)
            told = measured(run.time, run["angle"], run["valve"], signal)
            yield DesignRun(family, which, speed, limit, law, told, run.time, run["angle"])
