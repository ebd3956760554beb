"""Speed that tolerating an unknown machine costs, and what a diagnosis of it gives back.

A plant may name a study whose designs tolerate a machine that nobody has identified. Three designs
of each of its families step alike: the nominal one on the nominal plant, the tolerant one on the
machine that was found, and on that machine again the nominal design made anew: from the model with
all that was found, predicting over the latency and the lags in it, which it holds its margins for
within half a millisecond. Nothing but what is known differs between the first and the last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from controllers.joint.hysteresis_compensation import with_compensation
from controllers.joint.model import lag_beside
from controllers.joint.tracking import TrackingSpecification
from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from controllers.uncertainty import Uncertainty
from workbench.diagnosis.redesign import found_lags
from workbench.errors import check_choice
from workbench.evaluation.tolerance import tolerant_study
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.plants.plant import Plant
from workbench.simulation import simulate
from workbench.study.designs import ControllerRecipe
from workbench.study.plants import PlantRecipe
from workbench.study.read import load_study, shipped_study
from workbench.study.study import Case, Report, Study, Variation

PRESSURE_FILTER = 0.002
"""Time constant of the filter of the pressures, by which feedforward leads too, in s."""

CASE = "3 kg horizontal"
"""Case of the study 'controllers' whose rules are those of the nominal designs."""

WHICH = ("nominal", "tolerant", "redesigned")
"""The three designs of each family; all but the nominal one are for the machine."""


@dataclass(frozen=True, kw_only=True)
class Redesigned(ControllerRecipe):
    """A nominal design that is made anew from what was found of a machine."""

    machine: PlantRecipe

    def designed(self) -> MarginedDesign[Controller]:
        """Return the controller, which compensates the hysteresis that was found, too."""
        made = super().designed()
        return replace(made, controller=with_compensation(made.controller, self.machine.build()))


def nominal_recipe(family: str, plant: PlantRecipe) -> ControllerRecipe:
    """Return the nominal design of a family for a plant without latency."""
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


def redesigned_recipe(family: str, machine: PlantRecipe) -> Redesigned:
    """Return the nominal design of a family made anew from what was found of a machine."""
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
    tolerant = tolerant_study().controllers[family]
    own = recipe.checked_specification()
    behind = sum(late) + beside
    if "inner_bandwidth" in keys:
        # No loop around a dead time crosses over beyond its inverse.
        wanted["inner_bandwidth"] = min(own.inner_bandwidth, 1.0 / behind)
    if "prediction_time" in keys:
        # A move that is over before it arrives tells a prediction nothing; what swings on the gas
        # within the longer horizon is damped as where nothing is known.
        wanted["prediction_time"] = max(own.prediction_time, h * math.ceil(behind / h))
        wanted["damping"] = dict(tolerant.specification)["damping"]
    told = {**dict(recipe.specification), **{k: v for k, v in wanted.items() if k in keys}}
    unsure = Uncertainty.known(sum(late), sensor_lag=max(slow, default=0.0))
    # A plan asks of the valve what reaches the muscles.
    told["jerk_share"] *= flow_share(model, nominal_plant(machine).build(), machine.plant())
    # No slower than what tolerates more is a limit that a late machine may not meet.
    first, last, count = recipe.fastest.speeds
    slowest = min(last, tolerant.fastest.speeds[1]) if tolerant.fastest is not None else last
    steps = (count - 1) * math.log(first / slowest) / math.log(first / last)
    fastest = replace(
        recipe.fastest,
        speeds=(first, slowest, 1 + math.ceil(steps)),
        plants=recipe.fastest.plants[:1],
        late_sensitivity=math.inf,
        maximum_sensitivity=2.2,
        maximum_complementary=2.0,
        uncertainty=unsure,
    )
    made = {**vars(recipe), "specification": tuple(told.items()), "inertia_margin": ()}
    return Redesigned(**made | {"fastest": fastest}, machine=machine)


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


def study_of_redesign(machine: PlantRecipe, families: Sequence[str] = ()) -> Study:
    """Return the study of the three designs of each family along the steps of the tolerant study.

    Args:
        families: Controllers of the study 'tolerant'; by default all.
    """
    tolerant, nominal = tolerant_study(), nominal_plant(machine)
    known: dict[str, ControllerRecipe] = {}
    found: dict[str, ControllerRecipe] = {}
    kin = []
    # A name that is wrong is told before the first design, which takes half a minute.
    for family in families:
        check_choice("family of controllers", family, tolerant.controllers)
    for family in families or tolerant.controllers:
        names = [f"{family}, {which}" for which in WHICH]
        kin += [(name, family) for name in names]
        known[names[0]] = nominal_recipe(family, nominal)
        found |= {
            names[1]: tolerant.controllers[family],
            names[2]: redesigned_recipe(family, machine),
        }
    made = {name: replace(r, name=name) for name, r in (known | found).items()}
    cases = {
        name: Case(name, plant, {own: made[own] for own in recipes}, tolerant.scenarios)
        for name, plant, recipes in (
            ("nominal plant", nominal, known),
            ("machine that was found", machine, found),
        )
    }
    return Study(
        "redesign",
        Path.cwd() / "redesign",
        cases,
        {case.name: Variation(case.name, case.plant, case.name) for case in cases.values()},
        made,
        tolerant.scenarios,
        (),
        seeds=(0,),
        report=Report(kin=tuple(kin)),
    )
