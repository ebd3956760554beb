"""All plants: the workbench's own, those of installed packages, the user's, and saved ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from workbench.checked_json import TableShape, listed, named, number, read_json, scalar, text
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.linear_system import with_free_coefficients
from workbench.plants.plant import Plant, Value, adopt
from workbench.plants.written import is_written, plant_of_matlab, plant_of_text
from workbench.registry import Registry


def saved_plant(
    reference: str,
    options: Mapping[str, Value],
    nominal: Model,
    model: Model,
    *,
    given: Mapping[str, str] | None = None,
    own: Sequence[str] = (),
) -> dict[str, Any]:
    """Return what a file must say so that `plant_of_file` builds a model again.

    Args:
        options: Its options that are not at their defaults, in their units.
        model: The model to keep: the nominal one with other effects and parameters.
        given: Effects of the user's own as ``module:object``, by the name that they have.
        own: Laws of the user's own as ``module:object`` that further effects come from.
    """
    before, after = ([e.name for e in m.effects] for m in (nominal, model))
    known = {q.name: q.value for q in nominal.parameters}
    return {
        "name": reference,
        "options": dict(options),
        "effects": [(given or {}).get(name, name) for name in after if name not in before],
        "without": [name for name in before if name not in after],
        "parameters": {q.name: q.value for q in model.parameters if known.get(q.name) != q.value},
        **({"own": list(own)} if own else {}),
    }


_FILE = TableShape(
    {
        "plant": TableShape(
            {"name": text},
            {
                "options": named(scalar),
                "effects": listed(text),
                "without": listed(text),
                "parameters": named(number),
                "own": listed(text),
            },
        )
    }
)


def _with_found(model: Model, values: Mapping[str, float]) -> Model:
    """Set parameters; the bounds of effects reach as far as the values that were found.

    They may follow from the recordings, such as that of a delay from the sampling interval.
    """
    parameters = tuple(
        replace(q, value=v, lower=min(q.lower, v), upper=max(q.upper, v))
        if "." in q.name and (v := values.get(q.name)) is not None
        else q
        for q in model.parameters
    )
    return replace(model, parameters=parameters).with_parameters(values)


def _kept(path: Path) -> dict[str, Any]:
    fix = (
        "give the verdict.json of 'workbench diagnose', which has the key 'plant' (diagnose again"
        " if an older version wrote it)"
    )
    kept: dict[str, Any] = read_json(path, "plant", _FILE, fix=fix)["plant"]
    if kept["name"].endswith(".json"):
        raise WorkbenchError(f"plant {str(path)!r} names another file, {kept['name']!r}; {fix}")
    return kept


def nominal_of_file(path: Path) -> tuple[str, tuple[tuple[str, Value], ...]]:
    """Return name and options, in their units, of the plant that a file's model began as."""
    kept = _kept(path)
    return kept["name"], tuple(kept.get("options", {}).items())


def plant_of_file(path: Path, find: Any, *, folder: Path | None = None) -> Plant:
    """Return the plant that a file such as ``verdict.json`` keeps, as `saved_plant` returns it.

    Its options start from those that were kept; ``find`` returns a plant by its name.

    Args:
        folder: Where modules of the user may stand, beside the Python path.
    """
    kept = _kept(path)
    base: Plant = find(kept["name"])
    start = base.parse(kept.get("options", {}))

    def build(**options: Any) -> Model:
        chosen = {o.name: options[o.keyword] for o in base.options}
        model = base.model(
            chosen,
            effects=kept.get("effects", ()),
            without=kept.get("without", ()),
            folder=folder,
            own=kept.get("own", ()),
        )
        values = kept.get("parameters", {})
        if not values.keys() <= {q.name for q in model.parameters}:
            # A refit opened the coefficients of a linear system.
            model = with_free_coefficients(model)
        return _with_found(model, values)

    return replace(
        base,
        name=str(path),
        build=build,
        summary=f"the model of {path.name}, {base.summary or base.name}",
        options=tuple(replace(o, default=start.get(o.name, o.default)) for o in base.options),
    )


class Plants(Registry[Plant]):
    """Plants by name, as ``module:object``, as a transfer function, or as a file that keeps one.

    Such a file is a verdict.json, or one of MATLAB.
    """

    def get(self, name: str, *, folder: Path | None = None) -> Plant:
        if name.endswith(".json"):
            path = Path(name) if folder is None else folder / name
            return plant_of_file(path, lambda other: self.get(other, folder=folder), folder=folder)
        if name.lower().endswith(".mat"):
            return plant_of_matlab(Path(name) if folder is None else folder / name)
        if name.lower().endswith((".slx", ".mdl", ".m", ".fmu", ".mo", ".vi")):
            raise WorkbenchError(
                f"plant {name!r} is a file that only its own program runs, and no physics can be"
                " added to; write its equations ('workbench new-plant FILE'), or save a linear"
                f" system of it, such as [A, B, C, D] = linmod('{Path(name).stem}'); save"
                f" {Path(name).stem}.mat A B C D -v7"
            )
        return plant_of_text(name) if is_written(name) else super().get(name, folder=folder)


PLANTS = Plants("plant", Plant, package="workbench.plants", group="workbench.plants", adopt=adopt)
"""Plants by name; one of the user's own as ``module:object``: a function, a model or a Plant."""


def model_of(plant: Any) -> Model:
    """Return what stands for a plant as its model, with the defaults of its options.

    Args:
        plant: A `Model`, a function that returns one, a system of python-control, SciPy or CasADi,
            a `LinearModel`, or the name of a plant, such as ``"1 / (s + 1)"``.

    Raises:
        WorkbenchError: If it is none of these.

    Example:
        >>> [q.name for q in model_of("2 / (s (0.5 s + 1))").outputs]
        ['y']
    """
    if isinstance(plant, Model):
        return plant
    found = PLANTS.get(plant) if isinstance(plant, str) else adopt(plant, type(plant).__name__)
    return found.model()
