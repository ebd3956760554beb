"""The verb ``verify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.plant import (
    Hysteresis,
    Load,
    Parameters,
    Plane,
    Supply,
    Without,
    plant_from_options,
)
from workbench.errors import check_range
from workbench.model.units import quantity


def verify(
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="pid, sliding-mode or mpc; may be given several times. By default all.",
            metavar="NAME",
        ),
    ] = None,
    design_angle: Annotated[
        str, typer.Option(help="Angle at which the linear model is taken.", metavar="ANGLE")
    ] = "30deg",
    design_load: Annotated[
        str | None,
        typer.Option(
            help="Load for which the controller is designed; by default that of the plant.",
            metavar="MASS",
        ),
    ] = None,
    start: Annotated[
        str, typer.Option("--from", help="Angle before the step.", metavar="ANGLE")
    ] = "15deg",
    end: Annotated[
        str, typer.Option("--to", help="Angle after the step.", metavar="ANGLE")
    ] = "45deg",
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.")] = 0,
    load: Load = "3kg",
    plane: Plane = "horizontal",
    supply: Supply = "6bar",
    parameter: Parameters = None,
    without: Without = None,
    hysteresis: Hysteresis = False,
    out: Annotated[Path | None, typer.Option(help="JSON file for the metrics, in SI.")] = None,
) -> int:
    """Run controllers on the full plant through a step and back, and score what they do.

    Each controller is designed from the linear model of the nominal plant and run at 500 Hz with
    saturation, converters and sensor noise. Exit status 1 if a requirement is missed.

    Example: 'workbench verify -c pid -c mpc --from 15deg --to 45deg --hysteresis'.

    Args:
        controller: Names of controllers; all by default.
        design_angle: Angle at which the linear model is taken.
        design_load: Load of the design, or None for that of the plant.
        start: Angle before the step.
        end: Angle after the step.
        seed: Seed of the sensors' noise.
        load: Mass of the plates, with or without its unit.
        plane: Plane of the motion.
        supply: Supply pressure, gauge, with or without its unit.
        parameter: Changed parameters as NAME=VALUE.
        without: Effects to leave out.
        hysteresis: Whether both muscles have hysteresis.
        out: JSON file, or None.

    Returns:
        Exit status: 1 if a requirement is missed.

    Example:
        >>> verify(["pdi"])
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: controller is 'pdi'; it must be one of ...
    """
    from workbench.demo.closed_loop import REQUIREMENTS
    from workbench.demo.controller_designs import FROM_ONE_MODEL, design_controllers, design_model
    from workbench.verification import metrics, score, step_scenario
    from workbench.verification import verify as run_loop

    plant = plant_from_options(
        load,
        plane,
        supply,
        parameters=parameter or (),
        without=without or (),
        hysteresis=hysteresis,
    )
    nominal = plant_from_options(design_load or load, plane, supply)
    angles = [
        check_range(name, quantity(name, text, "deg"), 0.0, 60.0, "deg")
        for name, text in (
            ("design angle", design_angle),
            ("angle before the step", start),
            ("angle after the step", end),
        )
    ]
    linear = design_model(nominal, angles[0])
    scenario = step_scenario(from_deg=angles[1], to_deg=angles[2], back=True, hold=2.0)
    results = {}
    worst = 0.0
    for designed in design_controllers(linear, controller or FROM_ONE_MODEL):
        found = metrics(run_loop(designed, plant, scenario, seed=seed))
        total, verdicts = score(REQUIREMENTS, [found])
        worst = max(worst, total)
        typer.echo(str(found))
        typer.echo("  required")
        typer.echo("\n".join(f"    {verdict}" for verdict in verdicts))
        results[designed.name] = {
            metric.name: {"value": metric.value, "unit": metric.unit, "reason": metric.reason}
            for metric in found.values
        }
    if out is not None:
        from workbench.files import write_whole
        from workbench.reports.results import json_text

        write_whole(out, json_text({"scenario": scenario.name, "seed": seed, "runs": results}))
        typer.echo(f"written to {out}")
    return 0 if worst <= 1.0 else 1
