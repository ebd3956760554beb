"""Reads a study file; a mistake is one sentence with the file and the line where it stands.

`read_study` parses the file and computes nothing. `resolve` finds plants, designs, effects and
metrics, a user's own beside the file, and checks everything that can be known without a run.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from controllers.uncertainty import Uncertainty
from workbench.checked_json import Place, ShapeError
from workbench.data_folder import shipped_folder
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.model import Model
from workbench.model.units import of_difference, quantity, same_dimension
from workbench.operating_point.operating_point import check_value
from workbench.plants import DEFAULT_PLANT
from workbench.plants.registry import PLANTS
from workbench.registry import user_code
from workbench.study.dependencies import new_study, watched
from workbench.study.designs import ControllerRecipe, Fastest, Pairs
from workbench.study.feasible import can_have, check_demand, check_demands
from workbench.study.fields import TABLES, FieldTable, ToldError
from workbench.study.plants import PlantRecipe, tolerated
from workbench.study.study import (
    NOMINAL,
    Box,
    Case,
    Cause,
    Demand,
    Limitations,
    Report,
    Selection,
    Study,
    Variation,
)
from workbench.study.toml_lines import line_of
from workbench.verification import (
    METRICS,
    Change,
    Disturbance,
    Metric,
    Requirement,
    Scenario,
    SignalFault,
    Tolerance,
    signal_from_table,
)
from workbench.verification.metrics import metric_of, metric_sizes, metric_units, tolerance_of
from workbench.verification.requirements import limit_in_words
from workbench.verification.signals import Signal

SCHEMA = 1
"""Version of the study file; a file may say ``schema = 1``."""

_EVENTS: dict[str, tuple[type[Any], str, str]] = {
    "changes": (Change, "parameter", "value"),
    "disturbances": (Disturbance, "port", "level"),
}
"""What may happen during a run: its class, where it happens, and the key of its size."""

_MERGED = ("specification", "inertia_margin", "plan", "fastest", "parameters")


@dataclass(frozen=True)
class StudyFile:
    """A study as it was written, and the text that says it."""

    path: Path
    table: dict[str, Any]
    text: str

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """Add file and line of an entry to a mistake, unless a place further inside did."""
        try:
            yield
        except WorkbenchError as error:
            if str(error).startswith(f"{self.path}, line "):
                raise
            line = line_of(self.text, path)
            raise WorkbenchError(f"{self.path}, line {line}: {error}") from None


def read_study(path: str | Path) -> StudyFile:
    """Parse a study file, without looking at plants, designs or modules."""
    place = Path(path)
    try:
        text = place.read_text(encoding="utf-8")
        table = tomllib.loads(text)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise WorkbenchError(f"study {str(place)!r} cannot be read: {reason}") from None
    except UnicodeDecodeError:
        raise WorkbenchError(f"study {str(place)!r} is not UTF-8 text") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise WorkbenchError(f"{place}: {str(error)[:1].lower()}{str(error)[1:]}") from None
    return StudyFile(place, table, text)


def resolve(file: StudyFile, *, optional: bool = False) -> Study:
    """Find and check everything that a study names.

    Keys, units, names of parameters, effects, designs, scenarios and metrics, ranges, and
    requirements that nothing can meet.

    Args:
        optional: Whether plants, variations and scenarios that are marked as optional count.
    """
    table = dict(file.table)
    for part in ("plants", "variations", "scenarios"):
        rows = table.get(part)
        if isinstance(rows, dict) and not optional:
            table[part] = {
                name: row
                for name, row in rows.items()
                if not (isinstance(row, dict) and row.get("optional") is True)
            }
    new_study(file.path.parent)
    with watched():
        return _Resolver(file, table).study()


def load_study(path: str | Path, *, optional: bool = False) -> Study:
    """Read and resolve a study file.

    Example:
        >>> list(load_study(shipped_study("arm")).controllers)
        ['cascade PID', 'sliding mode', 'linear MPC']
    """
    return resolve(read_study(path), optional=optional)


def shipped_study(name: str) -> Path:
    """Return the file of a shipped study; its baseline is ``NAME.baseline.json`` beside it."""
    folder = shipped_folder() / "studies"
    check_choice("shipped study", name, sorted(path.stem for path in folder.glob("*.toml")))
    return folder / f"{name}.toml"


class _Resolver:
    """Builds a study from its table, the mistakes told with their lines."""

    def __init__(self, file: StudyFile, table: dict[str, Any]) -> None:
        self.path, self.at, self.table = file.path, file.at, table
        self.folder = file.path.resolve().parent

    def study(self) -> Study:
        self.check()
        top = self.table
        base, model = self.plant(top.get("plant", {}))
        plants = self.plants(base)
        self.scenarios_ = self.scenarios("", model)
        self.variations_: dict[str, Variation] = {}
        for case, plant in plants.items():
            nominal = Variation(case or NOMINAL, plant, case)
            self.variations_[nominal.name] = nominal
            for name in self.named("variations"):
                found = self.variation(name, case, plant, model)
                self.variations_[found.name] = found
        self.kinds = {v.kind: v for v in self.variations_.values()}
        cases = {
            case: self.at_one_rate(
                Case(case, plant, self.controllers(case, plant, model), self.scenarios(case, model))
            )
            for case, plant in plants.items()
        }
        self.controllers_: dict[str, ControllerRecipe] = {}
        for name in self.named("controllers"):
            owns = [c.controllers[name] for c in cases.values() if name in c.controllers]
            self.controllers_ |= {name: owns[0]} if owns else {}
        with self.at("controllers"):
            if not self.controllers_:
                raise WorkbenchError("no controller is left; see requires and plants")
        self.first = next(iter(self.controllers_.values())).plant
        output = self.first.plant().controlled_outputs(self.first.build())[0]
        self.output = next(q for q in self.first.build().outputs if q.name == output)
        selections = {
            name: self.selection(table, part, name)
            for part in ("controllers", "scenarios")
            for name, table in self.named(part).items()
            if set(table) & set(TABLES["selection"].fields)
        }
        own = self.metrics(top.get("metrics", []))
        controlled = dict.fromkeys(n for s in self.scenarios_.values() for n in s.references)
        units = metric_units(model, tuple(controlled), own)
        slowest = max(s.sample_time for s in self.scenarios_.values())
        with self.at("seeds"):
            seeds = tuple(top.get("seeds", [1]))
            if not seeds or len(set(seeds)) != len(seeds):
                raise WorkbenchError(
                    f"seeds is {list(seeds)!r}; give a list of different whole numbers from 0 on"
                )
        study = Study(
            name=top.get("name", self.path.stem),
            path=self.path,
            cases=cases,
            variations=self.variations_,
            controllers=self.controllers_,
            scenarios=self.scenarios_,
            demands=self.demands(units, cases, own),
            seeds=seeds,
            selections=selections,
            points=self.points(top.get("linear", {}), several=len(plants) > 1),
            box=self.box(top.get("robustness"), model, several=len(plants) > 1),
            tolerances=self.tolerances(units, own),
            sizes=metric_sizes(model, tuple(controlled), slowest, own),
            description=top.get("description", ""),
            report=self.report(top.get("report", {})),
            own_metrics=tuple(n for n in top.get("metrics", []) if ":" in n),
        )
        self.check_judged(study)
        return study

    def check(self) -> None:
        """Check what can be known of the file alone; numbers with a fixed unit are in SI then."""
        with self.at("schema"):
            if self.table.get("schema", SCHEMA) != SCHEMA:
                raise WorkbenchError(
                    f"schema is {self.table['schema']!r}; this version reads schema {SCHEMA}"
                )
        try:
            self.table = TABLES["study"](self.table, ())
        except ShapeError as error:
            with self.at(*error.place):
                told = isinstance(error, ToldError)
                raise WorkbenchError(
                    error.text if told else f"{_word(error.place)} {error.text}"
                ) from None

    def named(self, part: str) -> dict[str, Any]:
        """Return the tables of a part by name."""
        return dict(self.table.get(part, {}))

    def of_case(self, case: str, part: str, name: str) -> tuple[dict[str, Any], Place]:
        """Return what a case says of a part's table, and where."""
        own = self.named("plants").get(case, {}).get(part, {}).get(name, {})
        return own, ("plants", case, part, name) if own else (part, name)

    def names(
        self, table: Mapping[str, Any], key: str, known: Iterable[str], *path: str | int
    ) -> tuple[str, ...]:
        """Return the names of an entry, each of which is known."""
        with self.at(*path, key):
            found = table.get(key, [])
            return tuple(check_choice(key.removesuffix("s"), name, known) for name in found)

    def values(
        self, table: Mapping[str, Any], units: Mapping[str, str], what: str, *path: str | int
    ) -> Pairs:
        """Return quantities by name, in SI."""
        found = []
        for name, value in table.items():
            with self.at(*path, name):
                check_choice(what, name, units)
                found.append((name, quantity(name, value, units[name])))
        return tuple(found)

    def check_judged(self, study: Study) -> None:
        """Check that every requirement judges a run: one that judges none is always met."""
        runs = {(c, v.name, s) for v, c, s, _ in study.runs()}
        for i, demand in enumerate(study.demands):
            metric = demand.requirement.metric
            if not any(
                study.judges(demand, *run)
                and can_have(metric, study.scenarios[run[2]], study.metrics)
                for run in runs
            ):
                with self.at("requirements", i):
                    raise WorkbenchError(
                        f"the requirement on {metric} judges no run of this study; look at the"
                        " scenarios, variations, plants and 'judged' that leave none"
                    )

    def at_one_rate(self, case: Case) -> Case:
        """Return a case whose controllers step as often as the scenarios that they run."""
        recipes = dict(case.controllers)
        for name, recipe in case.controllers.items():
            designed = getattr(recipe.checked_specification(), "sample_time", None)
            chosen = self.named("controllers")[name].get("scenarios") or case.scenarios
            for scenario in (case.scenarios[s] for s in chosen if s in case.scenarios):
                h = scenario.sample_time
                if designed == 0.0:
                    designed, told = h, (*recipe.specification, ("sample_time", h))
                    recipes[name] = replace(recipe, specification=told)
                if isinstance(designed, float) and not math.isclose(designed, h, rel_tol=1e-6):
                    with self.at("controllers", name, "specification", "sample_time"):
                        raise WorkbenchError(
                            f"controller {name!r} steps every {designed:g} s and scenario"
                            f" {scenario.name!r} every {h:g} s; give both the same sample_time"
                        )
        return replace(case, controllers=recipes)

    def scenarios(self, case: str, model: Model) -> dict[str, Scenario]:
        found = {}
        for name, table in self.named("scenarios").items():
            own, path = self.of_case(case, "scenarios", name)
            found[name] = self.scenario(name, {**table, **own}, model, *path)
        return found

    def selection(self, table: Mapping[str, Any], *path: str | int) -> Selection:
        """Return which runs a controller or a scenario has."""
        return Selection(
            table.get("seeds"),
            self.names(table, "scenarios", self.scenarios_, *path),
            self.names(table, "variations", sorted(self.kinds), *path),
            table.get("judged", True),
        )

    def plant(self, given: Mapping[str, Any]) -> tuple[PlantRecipe, Model]:
        kind = given.get("kind", DEFAULT_PLANT)
        with self.at("plant", "kind"):
            PLANTS.get(kind, folder=self.folder)
        base = self.chosen(PlantRecipe(kind, folder=self.folder), given, TABLES["plant"], "plant")
        with self.at("plant", "kind"):
            base.build()
        recipe = self.varied(base, given, "plant")
        return recipe, recipe.build()

    def chosen(
        self, recipe: PlantRecipe, table: Mapping[str, Any], shape: FieldTable, *path: str | int
    ) -> PlantRecipe:
        """Return the plant with the options of a table."""
        plant = recipe.plant()
        known = [o.name for o in plant.options]
        for name in table:
            with self.at(*path, name):
                check_choice("key of the plant", name, [*known, *shape.fields])
                if name in known:
                    parsed = plant.parse({name: table[name]}, in_si=True)
                    recipe = recipe.varied(options=parsed.items())
                    # One option alone says which of them is wrong, and on which line.
                    replace(recipe, options=tuple(parsed.items()), effects=(), without=()).plant()
        return recipe

    def plants(self, base: PlantRecipe) -> dict[str, PlantRecipe]:
        """Return the plants that designs know, by the name of the case."""
        found = {}
        for name, table in self.named("plants").items():
            path = ("plants", name)
            own = self.chosen(base, table, TABLES["plants"], *path)
            found[name] = self.varied(own, table, *path)
            with self.at(*path):
                found[name].build()
            for part in ("controllers", "variations", "scenarios"):
                for key in table.get(part, {}):
                    with self.at(*path, part, key):
                        check_choice(part.removesuffix("s"), key, self.named(part))
        return found or {"": base}

    def varied(self, plant: PlantRecipe, table: Mapping[str, Any], *path: str | int) -> PlantRecipe:
        """Return a plant without and with effects, with other parameters and more noise."""
        known = [e.name for e in plant.build().effects]
        plant = plant.varied(without=self.names(table, "without", known, *path))
        with self.at(*path, "effects"):
            plant = plant.varied(effects=table.get("effects", ()))
            plant.build()
        units = {q.name: q.unit for q in plant.build().parameters}
        place = (*path, "parameters")
        for pair in self.values(table.get("parameters", {}), units, "parameter", *place):
            with self.at(*place, pair[0]):
                plant = plant.varied(parameters=[pair])
                plant.build()
        return plant.varied(noise=table.get("noise", 1.0))

    def variation(self, name: str, case: str, plant: PlantRecipe, model: Model) -> Variation:
        with self.at("variations", name):
            if name == NOMINAL:
                raise WorkbenchError(
                    f"variation {NOMINAL!r} is the plant itself; give another name"
                )
        table, path = self.variation_table(name, case)
        varied = self.varied(plant, table, *path)
        known = [q.name for q in varied.build().parameters]
        for key, factor in table.get("scaled", {}).items():
            with self.at(*path, "scaled", key):
                check_choice("parameter", key, known)
                check_range(f"factor on {key}", factor, 1e-6, 1e6)
                varied = varied.varied(scaled=[(key, factor)])
        own = {f.name for f in fields(Variation)} & set(table) - {"disturbances"}
        return Variation(
            **{
                **{key: table[key] for key in own},
                "name": f"{case}, {name}" if case else name,
                "plant": varied,
                "case": case,
                "kind": name,
                "scenarios": self.names(table, "scenarios", self.scenarios_, *path),
                "controllers": self.names(table, "controllers", self.named("controllers"), *path),
                "disturbances": self.events("disturbances", table, model, *path),
            }
        )

    def variation_table(self, name: str, case: str) -> tuple[dict[str, Any], Place]:
        """Return what is said about a variation, with what it is like and what its case says."""
        table = dict(self.named("variations")[name])
        like = table.pop("like", NOMINAL)
        with self.at("variations", name, "like"):
            check_choice("variation", like, [NOMINAL, *self.named("variations")])
            if like == name:
                raise WorkbenchError(f"variation {name!r} is like itself; name another one")
        if like != NOMINAL:
            table = {**self.variation_table(like, case)[0], **table}
        own, path = self.of_case(case, "variations", name)
        return {**table, **own}, path

    def controllers(
        self, case: str, plant: PlantRecipe, model: Model
    ) -> dict[str, ControllerRecipe]:
        found = {}
        cases = list(self.named("plants")) or [""]
        for name, table in self.named("controllers").items():
            allowed = self.names(table, "plants", cases, "controllers", name)
            missing = any(find_spec(package) is None for package in table.get("requires", []))
            if missing or (allowed and case not in allowed):
                continue
            own, path = self.of_case(case, "controllers", name)
            merged = {
                key: {**table.get(key, {}), **own[key]}
                for key in _MERGED
                if isinstance(own.get(key), dict)
            }
            found[name] = self.controller(
                name, {**table, **own, **merged}, plant, model, case, *path
            )
        return found

    def controller(
        self,
        name: str,
        table: dict[str, Any],
        plant: PlantRecipe,
        model: Model,
        case: str,
        *path: str | int,
    ) -> ControllerRecipe:
        with self.at(*path):
            TABLES["controller"].check_needed(table, path)
        own = self.varied(plant, table, *path)
        default = tuple(plant.plant().design_point.items())
        at = self.point(table["at"], model, *path, "at") if "at" in table else default
        with self.at(*path, "design"):
            recipe = ControllerRecipe(
                name, table["design"], own, at, guard=table.get("guard", False)
            )
            design = recipe.kind()
        keys = {key.name: key for key in design.keys}
        specification: dict[str, Any] = {}
        for key, value in table.get("specification", {}).items():
            with self.at(*path, "specification", key):
                specification[key] = keys[key].read(value) if key in keys else value
        if "fastest" in table:
            found = self.fastest(table["fastest"], recipe, specification, case, *path, "fastest")
            recipe = replace(recipe, fastest=found)
        for key, value in specification.items():
            with self.at(*path, "specification", key):
                _check_flag(recipe, key, value)
                recipe.checked_specification({key: _hashable(value)})
        written = tuple((key, _hashable(value)) for key, value in specification.items())
        recipe = replace(recipe, specification=written)
        with self.at(*path, "specification"):
            recipe.checked_specification()
        units = {q.name: q.unit for q in own.build().parameters}
        place = (*path, "inertia_margin")
        margin = self.values(table.get("inertia_margin", {}), units, "parameter", *place)
        plan = table.get("plan", {})
        with self.at(*path, "plan"):
            if plan and design.needs != "model":
                raise WorkbenchError(
                    "plan is for designs on the plant's model; others plan by their specification"
                )
        recipe = replace(recipe, inertia_margin=margin, plan=tuple(plan.items()))
        if design.needs == "linear":
            with self.at(*path, "at"):
                linear = recipe.linear()
            with self.at(*path, "specification"):
                check_names = getattr(recipe.checked_specification(), "check_names", None)
                if check_names is not None:
                    check_names(linear)
        return recipe

    def fastest(
        self,
        given: Mapping[str, Any],
        recipe: ControllerRecipe,
        specification: Mapping[str, Any],
        case: str,
        *path: str | int,
    ) -> Fastest:
        with self.at(*path):
            TABLES["fastest"].check_needed(given, path)
        table, model = dict(given), recipe.plant.build()
        kinds = {v.kind: v for v in self.variations_.values() if v.case == case}
        nominal = dict(kinds[NOMINAL].plant.parameters)
        names = self.names(table, "variations", kinds, *path) or (NOMINAL,)
        plants = []
        for name in names:
            varied = kinds[name].plant
            more = [e for e in varied.effects if e not in kinds[NOMINAL].plant.effects]
            plant = recipe.plant.varied(effects=more)
            known = {q.name for q in plant.build().parameters}
            changed = [(k, v) for k, v in varied.parameters if k in known and nominal.get(k) != v]
            plants.append(plant.varied(parameters=changed))
        table.pop("variations", None)
        if "uncertainty" in table:
            unsure = dict(table["uncertainty"])
            if unsure.pop("declared", True):
                plants += tolerated(recipe.plant)
            if "trusted_frequency" in unsure:
                unsure["trusted_frequency"] *= 2.0 * math.pi
            with self.at(*path, "uncertainty"):
                table["uncertainty"] = Uncertainty(**{k: _hashable(v) for k, v in unsure.items()})
        table["plants"] = tuple(plants)
        points = table.get("at", [dict(recipe.at)])
        table["at"] = tuple(self.point(p, model, *path, "at", i) for i, p in enumerate(points))
        with self.at(*path, "reduced"):
            if table.get("reduced"):
                check_choice("key that is reduced", table["reduced"], specification)
        with self.at(*path, "speeds"):
            first, last, _ = table["speeds"]
            if not first > last > 0:
                raise WorkbenchError(
                    f"speeds is {table['speeds']!r}; give the first, the last, lower one, and how"
                    " many"
                )
        return Fastest(**{k: _hashable(v) for k, v in table.items()})

    def point(self, given: Mapping[str, Any], model: Model, *path: str | int) -> Pairs:
        known = {q.name: q.unit for q in (*model.inputs, *model.outputs, *model.states)}
        return self.values(given, known, "value of the operating point", *path)

    def events(self, key: str, table: Mapping[str, Any], model: Model, *path: str | int) -> Any:
        """Return changes of parameters or disturbances of ports, in SI."""
        kind, which, column = _EVENTS[key]
        quantities = model.parameters if which == "parameter" else model.ports
        units = {q.name: q.unit for q in quantities}
        found = []
        for i, row in enumerate(table.get(key, ())):
            with self.at(*path, key, i):
                unit = units[check_choice(which, row[which], units)]
                event = kind(**{**row, column: quantity(column, row[column], unit)})
                if which == "parameter":
                    model.parameter(event.parameter).with_value(event.value)
                found.append(event)
        return tuple(found)

    def scenario(
        self, name: str, given: Mapping[str, Any], model: Model, *path: str | int
    ) -> Scenario:
        with self.at(*path):
            TABLES["scenario"].check_needed(given, path)
        own = {f.name for f in fields(Scenario)}
        table = {key: value for key, value in given.items() if key in own}
        if "start" in table:
            table["start"] = dict(self.point(table["start"], model, *path, "start"))
        outputs = {q.name: q.unit for q in model.outputs}
        signals = {}
        for output, signal in table["references"].items():
            with self.at(*path, "references", output):
                check_choice("controlled output", output, outputs)
                unit = signal.get("unit", outputs[output])
                signals[output] = signal_from_table({**signal, "unit": unit}, folder=self.folder)
                if not same_dimension(unit, outputs[output]):
                    raise WorkbenchError(
                        f"the reference of {output} is in {unit!r}; give it in a unit like"
                        f" {outputs[output]!r}"
                    )
        table["references"] = signals
        for key in _EVENTS:
            table[key] = self.events(key, table, model, *path)
        faults: list[SignalFault] = []
        for i, row in enumerate(table.get("faults", ())):
            with self.at(*path, "faults", i):
                faults.append(SignalFault(**row))
        with self.at(*path):
            scenario = Scenario(name, **table | {"faults": tuple(faults)})
        for key in _EVENTS:
            for i, event in enumerate(getattr(scenario, key)):
                with self.at(*path, key, i):
                    _check_before_end(f"an entry of {key}", event.time, scenario.duration)
        for output, value in (scenario.start or {}).items():
            with self.at(*path, "start", output):
                check_value(model, output, value)
        for output, reference in scenario.references.items():
            with self.at(*path, "references", output):
                _check_reference(model, output, reference, scenario)
        return scenario

    def metrics(self, given: Sequence[str]) -> tuple[Metric, ...]:
        found = []
        for i, name in enumerate(given):
            with self.at("metrics", i):
                metric = METRICS.get(name, folder=self.folder)
                if ":" in name and metric.name in METRICS.names():
                    raise WorkbenchError(
                        f"metric {name!r} is called {metric.name!r} like one of the workbench;"
                        " give it another name"
                    )
                if ":" in name:
                    found.append(metric)
        return tuple(found)

    def demands(
        self, units: Mapping[str, str], cases: Mapping[str, Case], own_metrics: tuple[Metric, ...]
    ) -> tuple[Demand, ...]:
        known: dict[str, Iterable[str]] = {
            "controllers": self.controllers_,
            "variations": {**self.kinds, **self.variations_},
            "plants": cases,
        }
        limits = {f.name for f in fields(Requirement)}
        found: list[Demand] = []
        for i, table in enumerate(self.table["requirements"]):
            path = ("requirements", i)
            chosen = {key: self.names(table, key, known[key], *path) for key in known}
            with self.at(*path, "scenario"):
                if table.get("scenario"):
                    check_choice("scenario of a requirement", table["scenario"], self.scenarios_)
            with self.at(*path, "metric"):
                check_choice("metric", table["metric"], units)
            given = {"unit": units[table["metric"]], **table}
            with self.at(*path, "limit"):
                if isinstance(limit := table["limit"], str):
                    about = metric_of(table["metric"], own_metrics)
                    assert about is not None, "it is one of those that have a unit"
                    words = limit_in_words(about, table["metric"], limit, given["unit"])
                    given["limit"], given["unit"] = words
                requirement = Requirement(**{k: v for k, v in given.items() if k in limits})
            with self.at(*path, "step"):
                step = self.step(table) if "step" in table else None
            unit = of_difference(self.output.display_unit)
            weight = table.get("weight", 1.0)
            found.append(Demand(requirement, weight, **chosen, step=step, step_unit=unit))
            with self.at(*path):
                check_demand(found[-1], units, self.scenarios_, self.controllers_, own_metrics)
                check_demands(found)
        return tuple(found)

    def step(self, table: Mapping[str, Any]) -> float:
        """Return the size of the steps that a requirement judges, in SI."""
        if table["metric"] not in ("settling_time", "overshoot"):
            raise WorkbenchError("step is for settling_time and overshoot only")
        step = quantity("step", table["step"], self.output.unit, difference=True)
        sizes = {
            abs(after - before)
            for s in self.scenarios_.values()
            for signal in s.references.values()
            for _, before, after in signal.changes
            if table.get("scenario") in (None, "", s.name)
        }
        if not any(math.isclose(step, size, rel_tol=1e-6) for size in sizes):
            raise WorkbenchError(
                f"no scenario of the requirement has a step of {table['step']}; give the size of a"
                " step, which is positive"
            )
        return step

    def points(self, table: Mapping[str, Any], *, several: bool) -> tuple[Pairs, ...]:
        """Return the points of the linear analysis; none of its own for several plants."""
        recipe = next(iter(self.controllers_.values()))
        if "angles" in table:
            rows, key = [{self.output.name: value} for value in table["angles"]], "angles"
        else:
            rows, key = table.get("points", []), "points"
        found = []
        for i, row in enumerate(rows):
            with self.at("linear", key, i):
                found.append(self.point(row, recipe.plant.build(), "linear", key, i))
                recipe.linear(found[-1])
        if found or several:
            return tuple(found)
        return tuple(dict.fromkeys(c.at for c in self.controllers_.values()))

    def box(self, table: Mapping[str, Any] | None, model: Model, *, several: bool) -> Box | None:
        if table is None:
            return None
        path = "robustness"
        with self.at(path):
            if several:
                raise WorkbenchError("a box is drawn from one plant; this study has several")
        ranges = {}
        for name, ends in table["box"].items():
            with self.at(path, "box", name):
                check_choice("parameter", name, [q.name for q in model.parameters])
                bounded = model.parameter(name)
                low, high = (quantity(name, v, bounded.unit) for v in ends)
                if not low < high:
                    raise WorkbenchError(f"range of {name} is {ends!r}; the first must be lower")
                bounded.with_value(low)
                bounded.with_value(high)
                ranges[name] = (low, high)
        scenarios = self.names(table, "scenarios", self.scenarios_, path)
        controllers = self.names(table, "controllers", self.controllers_, path)
        values = {k: table[k] for k in ("draws", "search", "seed", "hard") if k in table}
        return Box(ranges, scenarios or tuple(self.scenarios_)[:1], controllers, **values)

    def report(self, table: Mapping[str, Any]) -> Report:
        steps = []
        for i, ends in enumerate(table.get("limit_steps", ())):
            with self.at("report", "limit_steps", i):
                name = self.output.name
                before, after = (quantity(name, end, self.output.unit) for end in ends)
                for end in (before, after):
                    check_value(self.first.build(), name, end)
                steps.append((before, after))
        with self.at("report", "figures"):
            figures = table.get("figures", [])
            if not all(":" in name for name in figures):
                raise WorkbenchError(f"figures is {figures!r}; give a list such as ['mine:fast']")
        limitations = table.get("limitations")
        return Report(
            table.get("physical_limit", False),
            tuple(steps),
            self.names(table, "limit_variations", self.kinds, "report"),
            None if limitations is None else self.limitations(limitations),
            tuple(figures),
            self.names(table, "traced", self.kinds, "report"),
        )

    def limitations(self, given: Mapping[str, Any]) -> Limitations:
        path, table = ("report", "limitations"), dict(given)
        with self.at(*path, "scenario"):
            check_choice("scenario", table["scenario"], self.scenarios_)
        for key in ("unknown", "neglected", "loop", "design"):
            table[key] = cause = Cause(**table[key])
            with self.at(*path, key):
                if cause.variation:
                    check_choice("variation", cause.variation, self.kinds)
        names = self.names(table, "controllers", self.named("controllers"), *path)
        table["controllers"] = [n for n in names if n in self.controllers_]
        with self.at(*path, "ladder"):
            for kind, _ in table.get("ladder", ()):
                check_choice("variation", kind, self.kinds)
        return Limitations(**{k: _hashable(v) for k, v in table.items()})

    def tolerances(self, units: Mapping[str, str], own: tuple[Metric, ...]) -> dict[str, Tolerance]:
        found = {}
        for name, table in self.named("tolerances").items():
            with self.at("tolerances", name):
                check_choice("metric", name, units)
            found[name] = tolerance_of(name, own)._replace(**table)
            with self.at("tolerances", name, "absolute"):
                if "absolute" in table:
                    value = quantity("tolerance", table["absolute"], units[name], difference=True)
                    check_range("tolerance", value, 0.0, 1e12)
                    found[name] = found[name]._replace(absolute=value, typical=0.0)
        return found


def _check_flag(recipe: ControllerRecipe, key: str, value: Any) -> None:
    """Refuse true where a number belongs: Python would take it for 1."""
    kind = recipe.kind().specification
    usual = getattr(kind, "__dataclass_fields__", {}).get(key)
    if isinstance(value, bool) and usual is not None and "bool" not in str(usual.type):
        raise WorkbenchError(f"{key} is {value!r}; give a number")


def _check_reference(model: Model, output: str, signal: Signal, scenario: Scenario) -> None:
    """Check that a reference is one that the plant can have and the loop can see."""
    rate = 1.0 / scenario.sample_time
    frequency = getattr(signal, "frequency_Hz", 0.0)
    if frequency >= 0.5 * rate:
        raise WorkbenchError(
            f"the reference of {output} is a sine of {frequency:g} Hz; at {rate:g} samples per"
            f" second it must be below {0.5 * rate:g} Hz"
        )
    with user_code(f"reference of {output}"):
        changes = signal.changes
        values = signal.sample(np.linspace(0.0, scenario.duration, 1001))
    for time, _, _ in changes:
        _check_before_end(f"a step of the reference of {output}", time, scenario.duration)
    begin = getattr(signal, "begin", 0.0)
    _check_before_end(f"the reference of {output}", begin, scenario.duration)
    levels = (level for _, *ends in changes for level in ends)
    reached = [*np.ravel(values).tolist(), *levels]
    for value in (min(reached), max(reached)):
        check_value(model, output, value, what=f"the reference of {output}")


def _check_before_end(what: str, time: float, end: float) -> None:
    if time >= end:
        raise WorkbenchError(
            f"{what} begins at {time:g} s, and the scenario ends at {end:g} s; it would never"
            " happen"
        )


def _word(place: Place) -> str:
    """Return the last key of a place, with the indices behind it."""
    last = max((i for i, p in enumerate(place) if isinstance(p, str)), default=0)
    rest = "".join(f"[{p}]" for p in place[last + 1 :])
    return f"{place[last]}{rest}" if place else "the study"


def _hashable(value: Any) -> Any:
    return tuple(_hashable(v) for v in value) if isinstance(value, list) else value
