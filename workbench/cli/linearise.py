"""The verb ``linearise``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.as_json import AsJson
from workbench.cli.plant import (
    At,
    Effects,
    Options,
    Parameters,
    PlantName,
    Short,
    Without,
    chosen_plant,
)
from workbench.plants import DEFAULT_PLANT


def linearise(
    plant: PlantName = DEFAULT_PLANT,
    at: At = None,
    option: Options = None,
    parameter: Parameters = None,
    without: Without = None,
    effect: Effects = None,
    verdict: Annotated[
        bool,
        typer.Option(
            "--verdict", help="Also simulate how large and how fast a motion may be (seconds)."
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="JSON file for the operating point and the matrices A, B, C, D, in SI."),
    ] = None,
    as_json: AsJson = False,
    short: Short = None,
) -> int:
    """Trim a plant and print its linear model: modes, and how far to trust it.

    Examples: 'workbench linearise --angle 30deg --load 3kg --mean-pressure 3bar --verdict',
    'workbench linearise --plant my_plants:circuit --at voltage=2V'.
    """
    from workbench.linearisation import linearise as linear_model
    from workbench.operating_point import operating_point

    chosen = chosen_plant(
        plant,
        options=option,
        parameters=parameter,
        without=without,
        effects=effect,
        at=at,
        short=short,
        takes=("option", "effect", "at"),
    )
    point = operating_point(chosen.model, chosen.design_point)
    linear = linear_model(point)
    typer.echo(f"{point}\n\n{linear}", err=as_json)
    if verdict and linear.verdict is not None:
        typer.echo(f"\n{linear.verdict.amplitude}\n{linear.verdict.frequency}", err=as_json)
    if out is not None or as_json:
        from workbench.files import write_whole
        from workbench.reports.results import json_text

        content = {
            "plant": chosen.plant.name,
            "given": dict(point.given),
            "states": dict(zip(linear.state_names, linear.x0.tolist(), strict=True)),
            "inputs": dict(zip(linear.input_names, linear.u0.tolist(), strict=True)),
            "outputs": dict(zip(linear.output_names, linear.y0.tolist(), strict=True)),
            **{name: getattr(linear, name).tolist() for name in "ABCD"},
        }
        if as_json:
            typer.echo(json_text(content), nl=False)
        if out is not None:
            write_whole(out, json_text(content))
            typer.echo(f"written to {out}", err=as_json)
    return 0
