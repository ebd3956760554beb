"""Reads a study file; a mistake is one sentence with the file and the line where it stands.

`read_study` parses the file and computes nothing. `resolve` finds plants, designs, effects and
metrics, a user's own beside the file, and checks everything that can be known without a run.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from workbench.checked_json import Place, ShapeError
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.model import Model
from workbench.model.units import quantity, same_dimension
from workbench.operating_point.operating_point import check_value
from workbench.plants import DEFAULT_PLANT
from workbench.plants.registry import PLANTS
from workbench.registry import user_code
from workbench.study import shapes
from workbench.study.designs import ControllerRecipe, Fastest, Pairs
from workbench.study.feasible import can_have, check_demand, check_demands
from workbench.study.inputs import new_study, watched
from workbench.study.plants import PlantRecipe, checked_noise
from workbench.study.shapes import STUDY
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
from workbench.study.toml_tables import TomlTables, toml_lines
from workbench.verification import (
    METRICS,
    Disturbance,
    Metric,
    Scenario,
    Tolerance,
    requirement_from_table,
)
from workbench.verification.metrics import metric_units, tolerance_of
from workbench.verification.scenario import RANGES_S, scenario_from_table
from workbench.verification.signals import Signal

SCHEMA = 1
"""Version of the study file; a file may say ``schema = 1``."""

_MERGED = ("specification", "inertia_margin", "plan", "fastest", "parameters")


@dataclass(frozen=True)
class StudyFile:
    """A study as it was written.

    Args:
        table: What it holds.
        lines: Line by path of each entry.
    """

    path: Path
    table: dict[str, Any]
    lines: Mapping[tuple[str | int, ...], int]


def read_study(path: str | Path) -> StudyFile:
    """Parse a study file, without looking at plants, designs or modules.

    Raises:
        WorkbenchError: If it cannot be read, is no TOML, has an unknown or lacks a needed part.
    """
    place = Path(path)
    try:
        text = place.read_text(encoding="utf-8")
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise WorkbenchError(f"study {str(place)!r} cannot be read: {reason}") from None
    except UnicodeDecodeError:
        raise WorkbenchError(f"study {str(place)!r} is not UTF-8 text") from None
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise WorkbenchError(f"{place}: {str(error)[:1].lower()}{str(error)[1:]}") from None
    file = TomlTables(place, table, toml_lines(text))
    file.keys(table, STUDY.usual, "the study")
    with file.at("schema"):
        if table.get("schema", SCHEMA) != SCHEMA:
            raise WorkbenchError(
                f"schema is {table['schema']!r}; this version reads schema {SCHEMA}"
            )
    for key in ("controllers", "scenarios", "requirements"):
        if not table.get(key):
            raise WorkbenchError(f"{place}, line 1: the study has no {key}; add at least one")
    return StudyFile(place, table, file.lines)


def resolve(file: StudyFile, *, optional: bool = False) -> Study:
    """Find and check everything that a study names.

    Keys, units, names of parameters, effects, designs, scenarios and metrics, ranges, and
    requirements that nothing can meet.

    Args:
        optional: Whether plants, variations and scenarios that are marked as optional count.

    Raises:
        WorkbenchError: With file and line of the first mistake.
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
        return _Resolver(file.path, table, file.lines).study()


def load_study(path: str | Path, *, optional: bool = False) -> Study:
    """Read and resolve a study file.

    Args:
        optional: Whether parts that are marked as optional count.

    Raises:
        WorkbenchError: With file and line of the first mistake.

    Example:
        >>> from workbench.study.shipped import shipped_study
        >>> list(load_study(shipped_study("arm")).controllers)
        ['cascade PID', 'sliding mode', 'linear MPC']
    """
    return resolve(read_study(path), optional=optional)


class _Resolver(TomlTables):
    @property
    def folder(self) -> Path:
        return self.path.resolve().parent

    def study(self) -> Study:
        top = self.table
        try:
            STUDY(top, ())
        except ShapeError as error:
            with self.at(*error.place):
                raise WorkbenchError(f"{_word(error.place)} {error.text}") from None
        base, model = self.plant(top.get("plant", {}))
        plants = self.plants(base)
        scenarios = self.scenarios("", model)
        variations: dict[str, Variation] = {}
        for case, plant in plants.items():
            nominal = Variation(case or NOMINAL, plant, case)
            variations[nominal.name] = nominal
            for name in dict.fromkeys([n for n, _ in self.tables("variations")]):
                found = self.variation(name, case, plant, model, scenarios)
                variations[found.name] = found
        self.check_selected(variations)
        cases = {
            case: Case(
                case,
                plant,
                self.controllers(case, plant, model, variations),
                self.scenarios(case, model),
            )
            for case, plant in plants.items()
        }
        with self.at("controllers"):
            if not any(c.controllers for c in cases.values()):
                raise WorkbenchError("no controller is left; see requires and plants")
        self.check_rates(cases)
        controllers: dict[str, ControllerRecipe] = {}
        for name, _ in self.tables("controllers"):
            owns = [c.controllers[name] for c in cases.values() if name in c.controllers]
            if owns:
                controllers[name] = owns[0]
        kinds = {v.kind for v in variations.values()}
        selections = {
            name: self.selection(table, controllers, scenarios, kinds, part, name)
            for part in ("controllers", "scenarios")
            for name, table in self.tables(part)
            if set(table) & set(shapes.SELECTION)
        }
        controlled = tuple(dict.fromkeys(n for s in scenarios.values() for n in s.references))
        own = self.metrics(top.get("metrics", []))
        units = metric_units(model, controlled, own)
        study = Study(
            name=self.text("name", self.path.stem),
            path=self.path,
            cases=cases,
            variations=variations,
            controllers=controllers,
            scenarios=scenarios,
            demands=self.demands(units, scenarios, controllers, variations, cases, own),
            seeds=self.seeds(top.get("seeds", [1])),
            selections=selections,
            points=self.points(top.get("linear", {}), plants, controllers),
            box=self.box(top.get("robustness"), model, plants, scenarios, controllers),
            tolerances=self.tolerances(units, own),
            description=self.text("description", ""),
            report=self.report(top.get("report", {}), scenarios, controllers, variations),
            own_metrics=tuple(n for n in top.get("metrics", []) if ":" in n),
        )
        self.check_judged(study)
        return study

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

    def check_rates(self, cases: Mapping[str, Case]) -> None:
        """Check that controllers step as often as the scenarios that they run."""
        for case in cases.values():
            for name, recipe in case.controllers.items():
                designed = getattr(recipe.checked_specification(), "sample_time", None)
                chosen = self.table["controllers"][name].get("scenarios") or case.scenarios
                for scenario in (case.scenarios[s] for s in chosen):
                    h = scenario.sample_time
                    if isinstance(designed, float) and abs(designed - h) > 1e-9:
                        with self.at("controllers", name, "specification", "sample_time"):
                            raise WorkbenchError(
                                f"controller {name!r} steps every {designed:g} s and scenario"
                                f" {scenario.name!r} every {h:g} s; give both the same sample_time"
                            )

    def scenarios(self, case: str, model: Model) -> dict[str, Scenario]:
        own = self.table.get("plants", {}).get(case, {}).get("scenarios", {})
        found = {}
        for name, table in self.tables("scenarios"):
            path: tuple[str | int, ...] = ("scenarios", name)
            given = table
            if name in own:
                path, given = ("plants", case, *path), {**table, **own[name]}
            found[name] = self.scenario(name, given, model, *path)
        return found

    def selection(
        self,
        table: Mapping[str, Any],
        controllers: Mapping[str, Any],
        scenarios: Mapping[str, Any],
        variations: set[str],
        *path: str | int,
    ) -> Selection:
        """Return which runs a controller or a scenario has."""
        seeds = table.get("seeds")
        chosen = []
        for key, known in (("scenarios", scenarios), ("variations", sorted(variations))):
            with self.at(*path, key):
                chosen.append(_names(key, table.get(key, []), known))
        judged = self.flag(table, "judged", True, *path)
        return Selection(seeds, chosen[0], chosen[1], judged)

    def check_selected(self, variations: Mapping[str, Variation]) -> None:
        names = [name for name, _ in self.tables("controllers")]
        for variation in variations.values():
            with self.at("variations", variation.kind, "controllers"):
                _names("controllers", variation.controllers, names)

    def text(self, key: str, default: str) -> str:
        with self.at(key):
            found = self.table.get(key, default)
            if not isinstance(found, str):
                raise WorkbenchError(f"{key} is {found!r}; give text")
            return found

    def flag(self, table: Mapping[str, Any], key: str, default: bool, *path: str | int) -> bool:
        with self.at(*path, key):
            found = table.get(key, default)
            if not isinstance(found, bool):
                raise WorkbenchError(f"{key} is {found!r}; give true or false")
            return found

    def plant(self, given: Any) -> tuple[PlantRecipe, Model]:
        kind = str(given.get("kind", DEFAULT_PLANT)) if isinstance(given, dict) else DEFAULT_PLANT
        with self.at("plant", "kind"):
            options = [o.name for o in PLANTS.get(kind, folder=self.folder).options]
        table = self.keys(given, (*options, *shapes.PLANT.usual), "the plant", "plant")
        base = self.chosen(PlantRecipe(kind, folder=self.folder), table, "plant")
        with self.at("plant", "kind"):
            base.build()
        changes = {key: table[key] for key in shapes.VARIED if key in table}
        recipe = self.varied(base, changes, "the plant", "plant")
        return recipe, recipe.build()

    def chosen(
        self, recipe: PlantRecipe, table: Mapping[str, Any], *path: str | int
    ) -> PlantRecipe:
        """Return the plant with the options of a table."""
        plant = recipe.plant()
        for option in plant.options:
            if option.name in table:
                with self.at(*path, option.name):
                    parsed = plant.parse({option.name: table[option.name]}, in_si=True)
                    recipe = recipe.varied(options=parsed.items())
                    # One option alone says which of them is wrong, and on which line.
                    replace(recipe, options=tuple(parsed.items()), effects=(), without=()).plant()
        return recipe

    def plants(self, base: PlantRecipe) -> dict[str, PlantRecipe]:
        """Return the plants that designs know, by the name of the case."""
        found = {}
        options = [o.name for o in base.plant().options]
        known = (*options, *shapes.PLANTS.usual)
        for name, given in self.tables("plants"):
            path = ("plants", name)
            table = self.keys(given, known, f"plant {name!r}", *path)
            own = self.chosen(base, table, *path)
            changes = {key: table[key] for key in shapes.VARIED if key in table}
            found[name] = self.varied(own, changes, f"plant {name!r}", *path)
            with self.at(*path):
                found[name].build()
            for part in ("controllers", "variations", "scenarios"):
                known_names = [n for n, _ in self.tables(part)]
                self.keys(table.get(part, {}), known_names, f"{part} of {name}", *path, part)
        return found or {"": base}

    def varied(self, plant: PlantRecipe, given: Any, what: str, *path: str | int) -> PlantRecipe:
        table = self.keys(given, shapes.VARIED, what, *path)
        for key in ("without", "effects"):
            with self.at(*path, key):
                names = table.get(key, [])
                if key == "without":
                    known = [e.name for e in plant.build().effects]
                    for name in names:
                        check_choice("effect of the plant", name, known)
                plant = (
                    plant.varied(effects=names) if key == "effects" else plant.varied(without=names)
                )
                plant.build()
        model = plant.build()
        parameters = self.keys(
            table.get("parameters", {}),
            [q.name for q in model.parameters],
            "parameters",
            *path,
            "parameters",
        )
        for name, value in parameters.items():
            with self.at(*path, "parameters", name):
                number = quantity(name, value, model.parameter(name).unit)
                plant = plant.varied(parameters=[(name, number)])
                plant.build()
        if "noise" in table:
            with self.at(*path, "noise"):
                plant = plant.varied(noise=checked_noise(quantity("noise", table["noise"], "1")))
        return plant

    def variation(
        self,
        name: str,
        case: str,
        plant: PlantRecipe,
        model: Model,
        scenarios: Mapping[str, Scenario],
    ) -> Variation:
        path: tuple[str | int, ...] = ("variations", name)
        with self.at(*path):
            if name == NOMINAL:
                raise WorkbenchError(
                    f"variation {NOMINAL!r} is the plant itself; give another name"
                )
        table, path = self.variation_table(name, case)
        changes = {key: table[key] for key in shapes.VARIED if key in table}
        varied = self.varied(plant, changes, f"variation {name!r}", *path)
        units = {p.name: p.unit for p in model.ports}
        varied_model = varied.build()
        names = [q.name for q in varied_model.parameters]
        scaled = self.keys(table.get("scaled", {}), names, "scaled", *path, "scaled")
        for key, factor in scaled.items():
            with self.at(*path, "scaled", key):
                number = check_range(f"factor on {key}", quantity(key, factor, "1"), 1e-6, 1e6)
                varied = varied.varied(scaled=[(key, number)])
        numbers: dict[str, Any] = {}
        for key, unit in (("late_samples", "1"), ("plan_duration", "1"), ("lead", "s")):
            if key in table:
                with self.at(*path, key):
                    value = quantity(key, table[key], unit)
                    numbers[key] = int(value) if key == "late_samples" else value
        chosen: dict[str, Any] = {}
        for key, known in (("scenarios", scenarios), ("controllers", self.table["controllers"])):
            with self.at(*path, key):
                chosen[key] = _names(key, table.get(key, []), known)
        rows = []
        for i, row in enumerate(table.get("disturbances", ())):
            entry = self.event(row, "port", "level", units, *path, "disturbances", i)
            with self.at(*path, "disturbances", i):
                rows.append(Disturbance(**entry))
        return Variation(
            f"{case}, {name}" if case else name,
            varied,
            case,
            name,
            disturbances=tuple(rows),
            ideal=self.flag(table, "ideal", False, *path),
            judged=self.flag(table, "judged", True, *path),
            **chosen,
            **numbers,
        )

    def variation_table(self, name: str, case: str) -> tuple[dict[str, Any], tuple[str | int, ...]]:
        """Return what is said about a variation, with what it is like and what its case says."""
        path: tuple[str | int, ...] = ("variations", name)
        table = self.keys(
            self.table["variations"][name], shapes.VARIATION.usual, f"variation {name!r}", *path
        )
        like = table.pop("like", NOMINAL)
        with self.at(*path, "like"):
            check_choice("variation", like, [NOMINAL, *self.table["variations"]])
            if like == name:
                raise WorkbenchError(f"variation {name!r} is like itself; name another one")
        if like != NOMINAL:
            table = {**self.variation_table(like, case)[0], **table}
        own = self.table.get("plants", {}).get(case, {}).get("variations", {}).get(name, {})
        if own:
            path = ("plants", case, "variations", name)
            table = {
                **table,
                **self.keys(own, shapes.VARIATION.usual, f"variation {name!r}", *path),
            }
        return table, path

    def controllers(
        self,
        case: str,
        plant: PlantRecipe,
        model: Model,
        variations: Mapping[str, Variation],
    ) -> dict[str, ControllerRecipe]:
        found = {}
        cases = list(self.table.get("plants", {})) or [""]
        for name, given in self.tables("controllers"):
            path: tuple[str | int, ...] = ("controllers", name)
            table = self.keys(given, shapes.CONTROLLER.usual, f"controller {name!r}", *path)
            with self.at(*path, "plants"):
                allowed = _names("plants", table.get("plants", []), cases)
            if allowed and case not in allowed:
                continue
            if any(find_spec(str(package)) is None for package in table.get("requires", [])):
                continue
            own = self.table.get("plants", {}).get(case, {}).get("controllers", {}).get(name, {})
            if own:
                path = ("plants", case, "controllers", name)
                own = self.keys(own, shapes.CONTROLLER.usual, f"controller {name!r}", *path)
                merged = {
                    key: {**table.get(key, {}), **own[key]}
                    for key in _MERGED
                    if isinstance(own.get(key), dict)
                }
                table = {**table, **own, **merged}
            found[name] = self.controller(name, table, plant, model, case, variations, *path)
        return found

    def controller(
        self,
        name: str,
        table: dict[str, Any],
        plant: PlantRecipe,
        model: Model,
        case: str,
        variations: Mapping[str, Variation],
        *path: str | int,
    ) -> ControllerRecipe:
        changes = {key: table[key] for key in shapes.VARIED if key in table}
        own = self.varied(plant, changes, f"controller {name!r}", *path)
        default = plant.plant().design_point
        at = (
            self.point(table["at"], model, *path, "at") if "at" in table else tuple(default.items())
        )
        with self.at(*path, "design"):
            if "design" not in table:
                raise WorkbenchError(
                    f"controller {name!r} has no design; name one, or write module:function"
                )
            recipe = ControllerRecipe(name, str(table["design"]), own, at)
            design = recipe.kind()
        specification = table.get("specification", {})
        if not isinstance(specification, dict):
            specification = self.keys(specification, (), "the specification", *path)
        if "fastest" in table:
            recipe = replace(
                recipe,
                fastest=self.fastest(
                    table["fastest"], recipe, specification, case, variations, *path
                ),
            )
        for key, value in specification.items():
            with self.at(*path, "specification", key):
                _check_flag(recipe, key, value)
                recipe.checked_specification({key: _hashable(value)})
        recipe = replace(
            recipe, specification=tuple((k, _hashable(v)) for k, v in specification.items())
        )
        with self.at(*path, "specification"):
            recipe.checked_specification()
        units = {q.name: q.unit for q in own.build().parameters}
        margin = self.keys(
            table.get("inertia_margin", {}), list(units), "inertia_margin", *path, "inertia_margin"
        )
        more = []
        for key, value in margin.items():
            with self.at(*path, "inertia_margin", key):
                more.append((key, quantity(key, value, units[key])))
        plan = table.get("plan", {})
        with self.at(*path, "plan"):
            if not isinstance(plan, dict) or (plan and design.needs != "model"):
                raise WorkbenchError(
                    "plan is for designs on the plant's model; others plan by their specification"
                )
        recipe = replace(
            recipe,
            inertia_margin=tuple(more),
            plan=tuple(plan.items()),
            guard=self.flag(table, "guard", False, *path),
        )
        if design.needs == "linear":
            with self.at(*path, "at"):
                recipe.linear()
        return recipe

    def fastest(
        self,
        given: Any,
        recipe: ControllerRecipe,
        specification: Mapping[str, Any],
        case: str,
        variations: Mapping[str, Variation],
        *path: str | int,
    ) -> Fastest:
        path = (*path, "fastest")
        table = self.keys(given, shapes.FASTEST.usual, "fastest", *path)
        model = recipe.plant.build()
        kinds = {v.kind: v for v in variations.values() if v.case == case}
        nominal = dict(kinds[NOMINAL].plant.parameters)
        with self.at(*path, "variations"):
            names = _names("variations", table.pop("variations", [NOMINAL]), kinds)
        known = {q.name for q in model.parameters}
        plants = tuple(
            recipe.plant.varied(
                parameters=[
                    (k, v)
                    for k, v in kinds[name].plant.parameters
                    if k in known and nominal.get(k) != v
                ]
            )
            for name in names
        )
        points = table.pop("at", [dict(recipe.at)])
        at = tuple(self.point(p, model, *path, "at", i) for i, p in enumerate(points))
        with self.at(*path):
            for key in ("key", "speeds"):
                if key not in table:
                    raise WorkbenchError(f"fastest has no {key!r}; add it")
        with self.at(*path, "reduced"):
            reduced = table.get("reduced", "")
            if reduced:
                check_choice("key that is reduced", reduced, specification)
        with self.at(*path, "speeds"):
            speeds = table["speeds"]
            if not isinstance(speeds, list) or len(speeds) != 3 or not speeds[0] > speeds[1] > 0:
                raise WorkbenchError(
                    f"speeds is {speeds!r}; give the first, the last, lower one, and how many"
                )
        entries = {k: _hashable(v) for k, v in table.items()}
        return Fastest(at=at, plants=plants, **entries)

    def point(self, given: Any, model: Model, *path: str | int) -> Pairs:
        known = {q.name: q.unit for q in (*model.outputs, *model.states)}
        table = self.keys(given, list(known), "the operating point", *path)
        found = []
        for name, value in table.items():
            with self.at(*path, name):
                found.append((name, quantity(name, value, known[name])))
        return tuple(found)

    def event(
        self, row: Any, which: str, column: str, units: Mapping[str, str], *path: str | int
    ) -> dict[str, Any]:
        """Return one change or disturbance, in SI."""
        entry = self.keys(row, ("time", "until", which, column), str(path[-2]), *path)
        with self.at(*path):
            for needed in ("time", which, column):
                if needed not in entry:
                    raise WorkbenchError(f"an entry of {path[-2]} has no {needed!r}; add it")
            check_choice(which, entry[which], units)
            entry[column] = quantity(column, entry[column], units[entry[which]])
            for time in ("time", "until"):
                if time in entry:
                    entry[time] = quantity(time, entry[time], "s")
        return entry

    def scenario(self, name: str, given: Any, model: Model, *path: str | int) -> Scenario:
        table = self.keys(given, shapes.SCENARIO.usual, f"scenario {name!r}", *path)
        for key in (*shapes.SELECTION, "optional"):
            table.pop(key, None)
        for key in RANGES_S:
            if key in table:
                with self.at(*path, key):
                    table[key] = quantity(key, table[key], "s")
        if "start" in table:
            table["start"] = dict(self.point(table["start"], model, *path, "start"))
        outputs = {q.name: q.unit for q in model.outputs}
        references = self.keys(
            table.get("references", {}), list(outputs), "references", *path, "references"
        )
        for output, signal in references.items():
            with self.at(*path, "references", output):
                one = {"references": {output: signal}, "duration": table.get("duration", 1.0)}
                scenario_from_table(name, one, folder=self.folder)
                unit = str(signal.get("unit", "1"))
                if not same_dimension(unit, outputs[output]):
                    raise WorkbenchError(
                        f"the reference of {output} is in {unit!r}; give it in a unit like"
                        f" {outputs[output]!r}"
                    )
        for key, which, column, units in (
            ("changes", "parameter", "value", {q.name: q.unit for q in model.parameters}),
            ("disturbances", "port", "level", {p.name: p.unit for p in model.ports}),
        ):
            rows = []
            for i, row in enumerate(table.get(key, ())):
                entry = self.event(row, which, column, units, *path, key, i)
                with self.at(*path, key, i):
                    if key == "changes":
                        model.parameter(entry[which]).with_value(entry[column])
                    alone = {**table, "changes": (), "disturbances": (), key: [entry]}
                    scenario_from_table(name, alone, folder=self.folder)
                rows.append(entry)
            table[key] = rows
        with self.at(*path):
            scenario = scenario_from_table(name, table, folder=self.folder)
        for key in ("changes", "disturbances"):
            for i, event in enumerate(getattr(scenario, key)):
                with self.at(*path, key, i):
                    _check_before_end(f"an entry of {key}", event.time, scenario.duration)
        for output, given in (scenario.start or {}).items():
            with self.at(*path, "start", output):
                check_value(model, output, given)
        for output, signal in scenario.references.items():
            with self.at(*path, "references", output):
                _check_reference(model, output, signal, scenario)
        return scenario

    def metrics(self, given: Any) -> tuple[Metric, ...]:
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
        self,
        units: Mapping[str, str],
        scenarios: Mapping[str, Scenario],
        controllers: Mapping[str, ControllerRecipe],
        variations: Mapping[str, Variation],
        cases: Mapping[str, Case],
        own_metrics: tuple[Metric, ...],
    ) -> tuple[Demand, ...]:
        recipe = next(iter(controllers.values()))
        outputs = {q.name: q.unit for q in recipe.plant.build().outputs}
        kinds = {v.kind: v for v in variations.values()} | dict(variations)
        rows = self.table["requirements"]
        with self.at("requirements"):
            if not isinstance(rows, list):
                raise WorkbenchError("requirements is no list; write [[requirements]]")
        found: list[Demand] = []
        for i, row in enumerate(rows):
            path: tuple[str | int, ...] = ("requirements", i)
            table = self.keys(row, shapes.REQUIREMENT.usual, "a requirement", *path)
            weight = float(table.pop("weight", 1.0))
            chosen = {}
            for key, names in (
                ("controllers", controllers),
                ("variations", kinds),
                ("plants", cases),
            ):
                with self.at(*path, key):
                    chosen[key] = _names(key, table.pop(key, []), names)
            step = None
            if "step" in table:
                with self.at(*path, "step"):
                    if table.get("metric") not in ("settling_time", "overshoot"):
                        raise WorkbenchError("step is for settling_time and overshoot only")
                    output = recipe.plant.plant().controlled_outputs(recipe.plant.build())[0]
                    step = quantity("step", table.pop("step"), outputs[output])
                    sizes = {
                        abs(after - before)
                        for s in scenarios.values()
                        for signal in s.references.values()
                        for _, before, after in signal.changes
                        if table.get("scenario") in (None, "", s.name)
                    }
                    if not any(math.isclose(step, size, rel_tol=1e-6) for size in sizes):
                        raise WorkbenchError(
                            f"no scenario of the requirement has a step of {row['step']}; give the"
                            " size of a step, which is positive"
                        )
            with self.at(*path, "scenario"):
                if table.get("scenario"):
                    check_choice("scenario of a requirement", table["scenario"], scenarios)
            with self.at(*path, "metric"):
                if "metric" in table:
                    check_choice("metric", table["metric"], units)
                    table.setdefault("unit", units[table["metric"]])
            with self.at(*path, "limit"):
                requirement = requirement_from_table(table)
            demand = Demand(requirement, weight, **chosen, step=step)
            with self.at(*path):
                check_demand(demand, units, scenarios, controllers, own_metrics)
            found.append(demand)
            with self.at(*path):
                check_demands(found)
        return tuple(found)

    def seeds(self, given: Any) -> tuple[int, ...]:
        with self.at("seeds"):
            if not given or len(set(given)) != len(given):
                raise WorkbenchError(
                    f"seeds is {given!r}; give a list of different whole numbers from 0 on"
                )
            return tuple(given)

    def points(
        self,
        given: Any,
        plants: Mapping[str, PlantRecipe],
        controllers: Mapping[str, ControllerRecipe],
    ) -> tuple[Pairs, ...]:
        """Return the points of the linear analysis; none of its own for several plants."""
        table = self.keys(given, shapes.LINEAR.usual, "linear", "linear")
        recipe = next(iter(controllers.values()))
        output = next(iter(recipe.plant.plant().controlled_outputs(recipe.plant.build())))
        if "angles" in table:
            rows, key = [{output: value} for value in table["angles"]], "angles"
        else:
            rows, key = table.get("points", ()), "points"
        found = []
        for i, row in enumerate(rows):
            with self.at("linear", key, i):
                point = self.point(row, recipe.plant.build(), "linear", key, i)
                recipe.linear(point)
                found.append(point)
        if found or len(plants) > 1:
            return tuple(found)
        return tuple(dict.fromkeys(c.at for c in controllers.values()))

    def box(
        self,
        given: Any,
        model: Model,
        plants: Mapping[str, PlantRecipe],
        scenarios: Mapping[str, Scenario],
        controllers: Mapping[str, ControllerRecipe],
    ) -> Box | None:
        if given is None:
            return None
        path = "robustness"
        with self.at(path):
            if len(plants) > 1:
                raise WorkbenchError("a box is drawn from one plant; this study has several")
        table = self.keys(given, shapes.ROBUSTNESS.usual, path, path)
        names = [q.name for q in model.parameters]
        ranges = {}
        for name, ends in self.keys(table.get("box", {}), names, "the box", path, "box").items():
            with self.at(path, "box", name):
                bounded = model.parameter(name)
                low, high = (quantity(name, v, bounded.unit) for v in ends)
                if not low < high:
                    raise WorkbenchError(f"range of {name} is {ends!r}; the first must be lower")
                bounded.with_value(low)
                bounded.with_value(high)
                ranges[name] = (low, high)
        with self.at(path):
            if not ranges:
                raise WorkbenchError("robustness has no box; add [robustness.box]")
        values: dict[str, Any] = {}
        for key, known_names in (("scenarios", scenarios), ("controllers", controllers)):
            with self.at(path, key):
                values[key] = _names(key, table.get(key, []), known_names)
        values["scenarios"] = values["scenarios"] or tuple(scenarios)[:1]
        values |= {k: table[k] for k in ("draws", "search", "seed", "hard") if k in table}
        return Box(ranges, **values)

    def report(
        self,
        given: Any,
        scenarios: Mapping[str, Scenario],
        controllers: Mapping[str, ControllerRecipe],
        variations: Mapping[str, Variation],
    ) -> Report:
        table = self.keys(given, shapes.REPORT.usual, "report", "report")
        recipe = next(iter(controllers.values()))
        model = recipe.plant.build()
        units = {q.name: q.unit for q in model.outputs}
        output = next(iter(recipe.plant.plant().controlled_outputs(model)))
        steps = []
        for i, ends in enumerate(table.get("limit_steps", ())):
            with self.at("report", "limit_steps", i):
                steps.append(tuple(quantity(output, end, units[output]) for end in ends))
                for end in steps[-1]:
                    check_value(model, output, end)
        kinds = {v.kind: v for v in variations.values()}
        with self.at("report", "limit_variations"):
            varied = _names("variations", table.get("limit_variations", []), kinds)
        with self.at("report", "figures"):
            figures = _hashable(table.get("figures", []))
            if not isinstance(figures, tuple) or not all(":" in str(name) for name in figures):
                raise WorkbenchError(f"figures is {figures!r}; give a list such as ['mine:fast']")
        with self.at("report", "traced"):
            traced = _names("variations", table.get("traced", []), kinds)
        limitations = None
        if "limitations" in table:
            limitations = self.limitations(table["limitations"], scenarios, controllers, kinds)
        return Report(
            self.flag(table, "physical_limit", False, "report"),
            tuple(steps),  # type: ignore[arg-type]
            varied,
            limitations,
            figures,
            traced,
        )

    def limitations(
        self,
        given: Any,
        scenarios: Mapping[str, Scenario],
        controllers: Mapping[str, ControllerRecipe],
        kinds: Mapping[str, Variation],
    ) -> Limitations:
        path = ("report", "limitations")
        table = self.keys(given, shapes.LIMITATIONS.usual, "limitations", *path)
        with self.at(*path, "scenario"):
            check_choice("scenario", str(table.get("scenario", "")), scenarios)
        for key in ("unknown", "neglected", "loop", "design"):
            row = self.keys(table.get(key, {}), shapes.CAUSE.usual, key, *path, key)
            with self.at(*path, key):
                if "name" not in row:
                    raise WorkbenchError(f"{key} has no name; add it")
                if row.get("variation"):
                    check_choice("variation", row["variation"], kinds)
            table[key] = Cause(**row)
        with self.at(*path, "controllers"):
            known = [name for name, _ in self.tables("controllers")]
            names = _names("controllers", table.get("controllers", []), known)
            table["controllers"] = tuple(n for n in names if n in controllers)
        rungs = table.get("ladder", [])
        with self.at(*path, "ladder"):
            _names("variations", [r[0] for r in rungs], kinds)
        for key in ("ratio", "overshoot"):
            if key in table:
                with self.at(*path, key):
                    table[key] = quantity(key, table[key], "1")
        return Limitations(**{k: _hashable(v) for k, v in table.items()})

    def tolerances(self, units: Mapping[str, str], own: tuple[Metric, ...]) -> dict[str, Tolerance]:
        found = {}
        for name, given in self.tables("tolerances"):
            path = ("tolerances", name)
            with self.at(*path):
                check_choice("metric", name, units)
            table = self.keys(given, shapes.TOLERANCE.usual, f"tolerance of {name}", *path)
            if "absolute" in table:
                with self.at(*path, "absolute"):
                    value = quantity("tolerance", table["absolute"], units[name])
                    table["absolute"] = check_range("tolerance", value, 0.0, 1e12)
            found[name] = tolerance_of(name, own)._replace(**table)
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
    _check_before_end(
        f"the reference of {output}", getattr(signal, "begin", 0.0), scenario.duration
    )
    reached = [
        *np.ravel(values).tolist(),
        *(v for _, before, after in changes for v in (before, after)),
    ]
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


def _names(key: str, given: Any, known: Any) -> tuple[str, ...]:
    if not isinstance(given, (list, tuple)):
        raise WorkbenchError(f"{key} is {given!r}; give a list of names")
    return tuple(check_choice(key.removesuffix("s"), name, known) for name in given)


def _hashable(value: Any) -> Any:
    return tuple(_hashable(v) for v in value) if isinstance(value, list) else value
