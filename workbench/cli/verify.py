"""The verb ``verify``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.cli.as_json import AsJson, tell
from workbench.cli.plant import Chosen, value_at_rest, with_plant
from workbench.errors import WorkbenchError, check_choice, check_range

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel
    from workbench.model import Model
    from workbench.verification import Requirement, Scenario


@with_plant("option", "effect", "design")
def verify(
    chosen: Chosen,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="Design that starts from one linear model, such as pid, sliding-mode or mpc, or"
            " module:function of your own; may be given several times. By default all that fit.",
            metavar="NAME",
        ),
    ] = None,
    design: Annotated[
        list[str] | None,
        typer.Option(
            "--design",
            help="What the design takes for another than the plant has: an option, or a value at"
            " rest, such as load=1kg or angle=30deg; the short form is --design-load 1kg.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option("--from", help="Controlled output before the step.", metavar="VALUE"),
    ] = None,
    end: Annotated[
        str | None,
        typer.Option("--to", help="Controlled output after the step.", metavar="VALUE"),
    ] = None,
    hold: Annotated[str, typer.Option(help="Time between the steps.", metavar="TIME")] = "2s",
    sample_time: Annotated[
        str, typer.Option(help="Sample time of controllers and loop.", metavar="TIME")
    ] = "2ms",
    require: Annotated[
        list[str] | None,
        typer.Option(
            help="Largest value of a metric, such as settling_time=0.5s; may be given several"
            " times. By default what the plant declares.",
            metavar="METRIC=LIMIT",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.")] = 0,
    out: Annotated[Path | None, typer.Option(help="JSON file for the metrics, in SI.")] = None,
    as_json: AsJson = False,
) -> int:
    """Run controllers on the full plant through a step and back, and score what they do.

    Each controller is designed from the linear model of the nominal plant, without effects that are
    attached here, and run on the full plant with saturation, converters and sensor noise. Exit
    status 1 if a requirement is missed.

    Examples: 'workbench verify -c pid -c mpc --from 15deg --to 45deg --hysteresis',
    'workbench verify --plant my_plants:circuit -c my_designs:integral --from 0V --to 1V'.
    """
    from workbench.verification import metrics, score
    from workbench.verification import verify as run_loop

    linear = _design_model(chosen, [*(design or ()), *chosen.design])
    scenario = _scenario(chosen, linear, start, end, hold, sample_time)
    requirements = _requirements(chosen, require or ())
    results = {}
    worst = 0.0
    for designed in _designed(linear, controller or (), scenario):
        found = metrics(run_loop(designed, chosen.model, scenario, seed=seed))
        total, verdicts = score(requirements, [found])
        worst = max(worst, total)
        typer.echo(str(found), err=as_json)
        if verdicts:
            typer.echo("  required", err=as_json)
            typer.echo("\n".join(f"    {verdict}" for verdict in verdicts), err=as_json)
        results[designed.name] = {
            metric.name: {"value": metric.value, "unit": metric.unit, "reason": metric.reason}
            for metric in found.values
        }
    if out is not None or as_json:
        content = {"scenario": scenario.name, "seed": seed, "runs": results}
        tell(content, as_json=as_json, file=out)
    return 0 if worst <= 1.0 else 1


def _design_model(chosen: Chosen, changes: Sequence[str]) -> LinearModel:
    """Linearise the nominal plant, without friction whose slope at rest is not that of a motion."""
    from workbench.linearisation import linearise
    from workbench.operating_point import operating_point

    options, at = dict(chosen.options), dict(chosen.plant.design_point)
    known = {n for o in chosen.plant.options for n in (o.name, o.keyword)}
    for text in changes:
        name, _, value = text.partition("=")
        if name.replace("-", "_") in known:
            options |= chosen.plant.parse({name: value})
        else:
            at |= dict([value_at_rest(chosen.nominal, text)])
    model = chosen.plant.model(options, folder=Path.cwd())
    return linearise(operating_point(model.without(*model.dry_effects), at), verdict=False)


def _scenario(
    chosen: Chosen,
    linear: LinearModel,
    start: str | None,
    end: str | None,
    hold: str,
    sample_time: str,
) -> Scenario:
    from workbench.model.units import from_si, quantity
    from workbench.verification import Steps, step_scenario

    name = chosen.plant.controlled_outputs(chosen.model)[0]
    y0 = {n: float(y) for n, y in zip(linear.output_names, linear.y0, strict=True)}
    about = next(q for q in chosen.model.outputs if q.name == name)
    first, last = chosen.plant.step or (y0[name], y0[name] + about.scale)
    levels = [
        default if given is None else _level(chosen.model, f"{name}={given}", what)
        for given, default, what in (
            (start, first, f"{name} before the step"),
            (end, last, f"{name} after the step"),
        )
    ]
    held = check_range("time between the steps", quantity("time", hold, "s"), 1e-6, 1e5, "s")
    step = check_range("sample time", quantity("sample time", sample_time, "s"), 1e-6, held, "s")
    unit = about.display_unit
    begin, end_ = (float(from_si(v, unit)) for v in levels)
    asked = step_scenario(
        name, begin, end_, unit=unit, back=True, lead=0.25 * held, hold=held, sample_time=step
    )
    # Other controlled outputs stay as they are at the design point.
    others = {n: Steps((0.0,), (y0[n],)) for n in chosen.plant.controlled_outputs(chosen.model)[1:]}
    return replace(asked, references=dict(sorted({**asked.references, **others}.items())))


def _level(model: Model, text: str, what: str) -> float:
    """Return a level of the controlled output, inside the range of the state that it shows."""
    from workbench.model.units import from_si

    name, value = value_at_rest(model, text)
    about = next(q for q in model.outputs if q.name == name)
    bounded: Any = next((q for q in model.states if q.name == name and q.unit == about.unit), about)
    unit = about.display_unit
    lower, upper = (from_si(v, unit) for v in (bounded.lower, bounded.upper))
    check_range(what, from_si(value, unit), lower, upper, unit)
    return value


def _requirements(chosen: Chosen, given: Sequence[str]) -> tuple[Requirement, ...]:
    from workbench.model.units import parse_unit
    from workbench.verification import Requirement

    wanted = []
    for text in given:
        name, _, value = text.partition("=")
        number = value.strip().rstrip("%abcdefghijklmnopqrstuvwxyzABCDFGHIJKLMNOPQRSTUVWXYZ/ ")
        unit = value.strip()[len(number) :].strip()
        parse_unit(unit)
        try:
            limit = float(number)
        except ValueError:
            raise WorkbenchError(
                f"requirement {text!r} has no limit; write it as METRIC=LIMIT, such as"
                " settling_time=0.5s"
            ) from None
        wanted.append(Requirement(name.strip(), limit, unit))
    return tuple(wanted) or tuple(Requirement(*item) for item in chosen.plant.requirements)


def _designed(linear: LinearModel, names: Sequence[str], scenario: Scenario) -> list[Any]:
    """Return the named controllers, or those made for such a plant, or those for any plant."""
    from controllers.design import DESIGNS, designs_for

    # What a design for any linear model must be told: which output, and how often.
    told = {"measured": next(iter(scenario.references)), "sample_time": scenario.sample_time}

    def made(design: Any) -> Any:
        return design.controller(
            linear, design.specified({} if design.sensors or design.own else told)
        )

    one = {n: d for n, d in DESIGNS.members().items() if d.needs == "linear"}
    if names:
        found = [DESIGNS.get(name, folder=Path.cwd()) for name in names]
        for design in found:
            if design.needs != "linear":
                check_choice("controller", design.name, one)
        return [made(design) for design in found]
    fitting = designs_for(linear)
    if any(design.sensors for design in fitting):
        return [made(design) for design in fitting]
    plain = []
    for design in fitting:
        try:
            plain.append(made(design))
        except WorkbenchError as error:
            typer.echo(f"{design.name}: {error}")
    if not plain:
        raise WorkbenchError(
            f"no design of the workbench fits {linear.operating_point.model.name!r}; give one of"
            " your own with --controller module:function"
        )
    return plain
