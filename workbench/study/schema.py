"""Reads a study file; a mistake is one sentence with the file and the line where it stands."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.model import Model
from workbench.model.units import same_dimension
from workbench.study.designs import DESIGNS, ControllerRecipe
from workbench.study.feasible import check_demand, check_demands
from workbench.study.figures_of_merit import Rule, metric_units, rule
from workbench.study.located import Located
from workbench.study.plants import ARM_OPTIONS, PlantRecipe, checked_noise, own_function
from workbench.study.quantities import si_value
from workbench.study.study import NOMINAL, Box, Demand, Study
from workbench.study.tolerance_keys import TOLERANCE_KEYS
from workbench.study.toml_lines import toml_lines
from workbench.verification import Requirement, Scenario, requirement_from_table
from workbench.verification.scenario import scenario_from_table

SCHEMA = 1
"""Version of the study file; a file may say ``schema = 1``."""

_KEYS = (
    "schema",
    "name",
    "description",
    "plant",
    "variations",
    "controllers",
    "scenarios",
    "requirements",
    "seeds",
    "linear",
    "robustness",
    "tolerances",
    "report",
)
_VARIED = ("parameters", "effects", "without", "noise")


def load_study(path: str | Path) -> Study:
    """Read and check a study file.

    Everything that can be known without a run is checked: keys, units, names of parameters,
    effects, designs, scenarios and metrics, ranges, and requirements that nothing can meet.

    Args:
        path: TOML file.

    Returns:
        The study.

    Raises:
        WorkbenchError: With file and line of the first mistake.

    Example:
        >>> from workbench.study.shipped import shipped_study
        >>> list(load_study(shipped_study("arm")).controllers)
        ['cascade PID', 'sliding mode', 'linear MPC']
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
    except tomllib.TOMLDecodeError as error:
        raise WorkbenchError(f"{place}: {str(error)[:1].lower()}{str(error)[1:]}") from None
    folder = str(place.resolve().parent)
    if ":" in "".join(_places(table)) and folder not in sys.path:
        # Plants and designs of one's own stand beside the study.
        sys.path.append(folder)
    return _Reader(place, table, toml_lines(text)).study()


def _places(table: dict[str, Any]) -> list[str]:
    """Return what a study says about where plants and designs are found."""
    controllers = table.get("controllers", {})
    rows = [
        table.get("plant", {}),
        *(controllers.values() if isinstance(controllers, dict) else ()),
    ]
    return [str(r.get("kind", r.get("design", ""))) for r in rows if isinstance(r, dict)]


class _Reader(Located):
    def study(self) -> Study:
        top = self.keys(self.table, _KEYS, "the study")
        with self.at("schema"):
            if top.get("schema", SCHEMA) != SCHEMA:
                raise WorkbenchError(
                    f"schema is {top['schema']!r}; this version reads schema {SCHEMA}"
                )
        for key in ("controllers", "scenarios", "requirements"):
            if not top.get(key):
                raise WorkbenchError(
                    f"{self.path}, line 1: the study has no {key}; add at least one"
                )
        plant, model = self.plant(top.get("plant", {}))
        variations = {NOMINAL: plant}
        for name, table in self.tables("variations"):
            with self.at("variations", name):
                if name == NOMINAL:
                    raise WorkbenchError(
                        f"variation {NOMINAL!r} is the plant itself; give another name"
                    )
            variations[name] = self.varied(plant, table, f"variation {name!r}", "variations", name)
        scenarios = {name: self.scenario(name, t, model) for name, t in self.tables("scenarios")}
        controllers = {
            name: self.controller(name, table, plant, model)
            for name, table in self.tables("controllers")
        }
        follows = tuple(dict.fromkeys(n for s in scenarios.values() for n in s.references))
        units = metric_units(model, follows)
        demands = self.demands(units, scenarios, controllers, variations)
        return Study(
            name=str(top.get("name", self.path.stem)),
            path=self.path,
            plant=plant,
            variations=variations,
            controllers=controllers,
            scenarios=scenarios,
            demands=demands,
            seeds=self.seeds(top.get("seeds", [1])),
            angles=self.angles(top.get("linear", {}), model, controllers),
            box=self.box(top.get("robustness"), model, scenarios, controllers),
            tolerances=self.tolerances(units),
            description=str(top.get("description", "")),
            physical_limit=self.physical_limit(top.get("report", {})),
        )

    def plant(self, given: Any) -> tuple[PlantRecipe, Model]:
        known = ("kind", *ARM_OPTIONS, *_VARIED)
        table = self.keys(given, known, "the plant", "plant")
        options = []
        for key, unit in ARM_OPTIONS.items():
            if key in table:
                with self.at("plant", key):
                    value = si_value(key, table[key], unit) if unit else table[key]
                    options.append((key, value))
                    # One option alone says which of them is wrong, and on which line.
                    PlantRecipe("arm", ((key, value),)).build()
        base = PlantRecipe(str(table.get("kind", "arm")), tuple(options))
        with self.at("plant", "kind"):
            base.build()
        changes = {key: table[key] for key in _VARIED if key in table}
        recipe = self.varied(base, changes, "the plant", "plant")
        return recipe, recipe.build()

    def varied(self, plant: PlantRecipe, given: Any, what: str, *path: str | int) -> PlantRecipe:
        table = self.keys(given, _VARIED, what, *path)
        for key in ("effects", "without"):
            with self.at(*path, key):
                names = table.get(key, [])
                if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
                    raise WorkbenchError(f"{key} is {names!r}; give a list of names")
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
                number = si_value(name, value, model.parameter(name).unit)
                plant = plant.varied(parameters=[(name, number)])
                plant.build()
        if "noise" in table:
            with self.at(*path, "noise"):
                plant = plant.varied(noise=checked_noise(si_value("noise", table["noise"], "1")))
        return plant

    def controller(
        self, name: str, given: Any, plant: PlantRecipe, model: Model
    ) -> ControllerRecipe:
        path = ("controllers", name)
        known = ("design", "at", "specification", *_VARIED)
        table = self.keys(given, known, f"controller {name!r}", *path)
        with self.at(*path, "design"):
            if "design" not in table:
                raise WorkbenchError(
                    f"controller {name!r} has no design; give one of {', '.join(DESIGNS)}, or"
                    " module:function"
                )
            design = str(table["design"])
            if ":" in design:
                own_function("design", design)
            else:
                check_choice("design", design, DESIGNS)
        changes = {key: table[key] for key in _VARIED if key in table}
        own = self.varied(plant, changes, f"controller {name!r}", *path)
        default = {"angle": "30 deg"} if "angle" in [q.name for q in model.outputs] else {}
        at = self.point(table.get("at", default), model, *path, "at")
        specification = table.get("specification", {})
        if not isinstance(specification, dict):
            specification = self.keys(specification, (), "the specification", *path)
        recipe = ControllerRecipe(name, design, own, at)
        for key, value in specification.items():
            with self.at(*path, "specification", key):
                replace(recipe, specification=((key, _hashable(value)),)).checked_specification()
        recipe = replace(
            recipe, specification=tuple((k, _hashable(v)) for k, v in specification.items())
        )
        with self.at(*path, "specification"):
            recipe.checked_specification()
        with self.at(*path, "at"):
            recipe.linear()
        return recipe

    def point(self, given: Any, model: Model, *path: str | int) -> tuple[tuple[str, float], ...]:
        known = {q.name: q.unit for q in (*model.outputs, *model.states)}
        table = self.keys(given, list(known), "the operating point", *path)
        found = []
        for name, value in table.items():
            with self.at(*path, name):
                found.append((name, si_value(name, value, known[name])))
        return tuple(found)

    def scenario(self, name: str, given: Any, model: Model) -> Scenario:
        path = ("scenarios", name)
        fields = (
            "references",
            "duration",
            "sample_time",
            "start",
            "settle",
            "changes",
            "disturbances",
            "noise",
            "quantise",
        )
        table = self.keys(given, fields, f"scenario {name!r}", *path)
        for key in ("noise", "quantise"):
            with self.at(*path, key):
                if not isinstance(table.get(key, True), bool):
                    raise WorkbenchError(f"{key} is {table[key]!r}; give true or false")
        for key in ("duration", "sample_time", "settle"):
            if key in table:
                with self.at(*path, key):
                    table[key] = si_value(key, table[key], "s")
        if "start" in table:
            table["start"] = dict(self.point(table["start"], model, *path, "start"))
        outputs = {q.name: q.unit for q in model.outputs}
        references = self.keys(
            table.get("references", {}), list(outputs), "references", *path, "references"
        )
        for output, signal in references.items():
            with self.at(*path, "references", output):
                one = scenario_from_table(
                    name, {"references": {output: signal}, "duration": table.get("duration", 1.0)}
                )
                unit = str(signal.get("unit", "1"))
                if not same_dimension(unit, outputs[output]):
                    raise WorkbenchError(
                        f"the reference of {output} is in {unit!r}; give it in a unit like"
                        f" {outputs[output]!r}"
                    )
                del one
        for key, column, units in (
            ("changes", "value", {q.name: q.unit for q in model.parameters}),
            ("disturbances", "level", {p.name: p.unit for p in model.ports}),
        ):
            which = "parameter" if key == "changes" else "port"
            rows = []
            for i, row in enumerate(table.get(key, ())):
                entry = self.keys(row, ("time", "until", which, column), f"{key}", *path, key, i)
                with self.at(*path, key, i):
                    for needed in ("time", which, column):
                        if needed not in entry:
                            raise WorkbenchError(f"an entry of {key} has no {needed!r}; add it")
                    check_choice(which, entry[which], units)
                    entry[column] = si_value(column, entry[column], units[entry[which]])
                    for time in ("time", "until"):
                        if time in entry:
                            entry[time] = si_value(time, entry[time], "s")
                    if key == "changes":
                        model.parameter(entry[which]).with_value(entry[column])
                    scenario_from_table(
                        name, {**table, "changes": (), "disturbances": (), key: [entry]}
                    )
                rows.append(entry)
            table[key] = rows
        with self.at(*path):
            return scenario_from_table(name, table)

    def demands(
        self,
        units: Mapping[str, str],
        scenarios: Mapping[str, Scenario],
        controllers: Mapping[str, ControllerRecipe],
        variations: Mapping[str, PlantRecipe],
    ) -> tuple[Demand, ...]:
        known = (*Requirement.__dataclass_fields__, "weight", "controllers", "variations")
        rows = self.table["requirements"]
        with self.at("requirements"):
            if not isinstance(rows, list):
                raise WorkbenchError("requirements is no list; write [[requirements]]")
        found = []
        for i, row in enumerate(rows):
            path: tuple[str | int, ...] = ("requirements", i)
            table = self.keys(row, known, "a requirement", *path)
            with self.at(*path, "weight"):
                weight = check_range("weight", table.pop("weight", 1.0), 0.0, 1e6)
            chosen = {}
            for key, names in (("controllers", controllers), ("variations", variations)):
                with self.at(*path, key):
                    chosen[key] = _names(key, table.pop(key, []), names)
            with self.at(*path, "scenario"):
                if table.get("scenario"):
                    check_choice("scenario of a requirement", table["scenario"], scenarios)
            with self.at(*path, "metric"):
                if "metric" in table:
                    check_choice("metric", table["metric"], units)
                    table.setdefault("unit", units[table["metric"]])
            with self.at(*path, "limit"):
                requirement = requirement_from_table(table)
            demand = Demand(requirement, weight, **chosen)
            with self.at(*path):
                check_demand(demand, units, scenarios, controllers)
            found.append(demand)
            with self.at(*path):
                check_demands(found)
        return tuple(found)

    def seeds(self, given: Any) -> tuple[int, ...]:
        with self.at("seeds"):
            whole = isinstance(given, list) and all(type(s) is int and s >= 0 for s in given)
            if not whole or not given or len(set(given)) != len(given):
                raise WorkbenchError(
                    f"seeds is {given!r}; give a list of different whole numbers from 0 on"
                )
            return tuple(given)

    def angles(
        self, given: Any, model: Model, controllers: Mapping[str, ControllerRecipe]
    ) -> tuple[tuple[tuple[str, float], ...], ...]:
        table = self.keys(given, ("angles",), "linear", "linear")
        points = []
        for i, value in enumerate(table.get("angles", ())):
            with self.at("linear", "angles", i):
                point = (("angle", si_value("angle", value, "rad")),)
                next(iter(controllers.values())).linear(point)
                points.append(point)
        return tuple(points) or tuple(dict.fromkeys(c.at for c in controllers.values()))

    def box(
        self,
        given: Any,
        model: Model,
        scenarios: Mapping[str, Scenario],
        controllers: Mapping[str, ControllerRecipe],
    ) -> Box | None:
        if given is None:
            return None
        path = "robustness"
        known = ("box", "scenarios", "controllers", "draws", "search", "seed", "hard")
        table = self.keys(given, known, path, path)
        names = [q.name for q in model.parameters]
        ranges = {}
        for name, ends in self.keys(table.get("box", {}), names, "the box", path, "box").items():
            with self.at(path, "box", name):
                if not isinstance(ends, list) or len(ends) != 2:
                    raise WorkbenchError(f"range of {name} is {ends!r}; give lowest and highest")
                quantity = model.parameter(name)
                low, high = (si_value(name, v, quantity.unit) for v in ends)
                if not low < high:
                    raise WorkbenchError(f"range of {name} is {ends!r}; the first must be lower")
                quantity.with_value(low)
                quantity.with_value(high)
                ranges[name] = (low, high)
        with self.at(path):
            if not ranges:
                raise WorkbenchError("robustness has no box; add [robustness.box]")
        values: dict[str, Any] = {}
        for key, known_names in (("scenarios", scenarios), ("controllers", controllers)):
            with self.at(path, key):
                values[key] = _names(key, table.get(key, []), known_names)
        values["scenarios"] = values["scenarios"] or tuple(scenarios)[:1]
        for key, lower, upper in (("draws", 4, 10_000), ("search", 0, 1000), ("seed", 0, 2**31)):
            if key in table:
                with self.at(path, key):
                    values[key] = int(check_range(key, table[key], lower, upper))
        with self.at(path, "hard"):
            if not isinstance(table.get("hard", False), bool):
                raise WorkbenchError(f"hard is {table['hard']!r}; give true or false")
        return Box(ranges, hard=table.get("hard", False), **values)

    def physical_limit(self, given: Any) -> bool:
        table = self.keys(given, ("physical_limit",), "report", "report")
        wanted = table.get("physical_limit", False)
        with self.at("report", "physical_limit"):
            if not isinstance(wanted, bool):
                raise WorkbenchError(f"physical_limit is {wanted!r}; give true or false")
        return wanted

    def tolerances(self, units: Mapping[str, str]) -> dict[str, Rule]:
        found = {}
        known = ("absolute", "relative", "better", "gates")
        for name, given in self.tables("tolerances"):
            with self.at("tolerances", name):
                check_choice("metric", name, units)
            table = self.keys(given, known, f"tolerance of {name}", "tolerances", name)
            own = rule(name)
            for key, read in TOLERANCE_KEYS.items():
                if key in table:
                    with self.at("tolerances", name, key):
                        own = own._replace(**{key: read(table[key], units[name])})
            found[name] = own
        return found


def _names(key: str, given: Any, known: Mapping[str, Any]) -> tuple[str, ...]:
    if not isinstance(given, list):
        raise WorkbenchError(f"{key} is {given!r}; give a list of names")
    return tuple(check_choice(key.removesuffix("s"), name, known) for name in given)


def _hashable(value: Any) -> Any:
    return tuple(_hashable(v) for v in value) if isinstance(value, list) else value
