"""The verb ``linearise``."""

from __future__ import annotations

import math
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


def linearise(
    angle: Annotated[
        str, typer.Option(help="Angle of the operating point, 0 to 60 degrees.", metavar="ANGLE")
    ] = "30deg",
    mean_pressure: Annotated[
        str | None,
        typer.Option(
            help="Mean gauge pressure of both muscles; by default the one that the valve's "
            "leakage holds.",
            metavar="PRESSURE",
        ),
    ] = None,
    load: Load = "3kg",
    plane: Plane = "horizontal",
    supply: Supply = "6bar",
    parameter: Parameters = None,
    without: Without = None,
    hysteresis: Hysteresis = False,
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
) -> int:
    """Trim the arm at an angle and print its linear model: modes, and how far to trust it.

    Example: 'workbench linearise --angle 30deg --load 3kg --mean-pressure 3bar --verdict'.

    Args:
        angle: Angle of the operating point.
        mean_pressure: Mean gauge pressure of both muscles, or None for the one that leakage holds.
        load: Mass of the plates, with or without its unit.
        plane: Plane of the motion.
        supply: Supply pressure, gauge, with or without its unit.
        parameter: Changed parameters as NAME=VALUE.
        without: Effects to leave out.
        hysteresis: Whether both muscles have hysteresis.
        verdict: Whether to simulate how far the model holds.
        out: JSON file, or None.

    Returns:
        Exit status.

    Example:
        >>> linearise("75deg")
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: angle is 75 deg; the valid range is 0 to 60 deg
    """
    from workbench.linearisation import linearise as linear_model
    from workbench.operating_point import operating_point

    model = plant_from_options(
        load,
        plane,
        supply,
        parameters=parameter or (),
        without=without or (),
        hysteresis=hysteresis,
    )
    degrees = check_range("angle", quantity("angle", angle, "deg"), 0.0, 60.0, "deg")
    bar = None if mean_pressure is None else quantity("mean pressure", mean_pressure, "bar")
    point = operating_point(
        model,
        {"angle": math.radians(degrees)},
        mean_pressure=None if bar is None else 1e5 * bar,
    )
    linear = linear_model(point)
    typer.echo(f"{point}\n\n{linear}")
    if verdict and linear.verdict is not None:
        typer.echo(f"\n{linear.verdict.amplitude}\n{linear.verdict.frequency}")
    if out is not None:
        from workbench.files import write_whole
        from workbench.reports.results import json_text

        content = {
            "angle_rad": math.radians(degrees),
            "states": dict(zip(linear.state_names, linear.x0.tolist(), strict=True)),
            "inputs": dict(zip(linear.input_names, linear.u0.tolist(), strict=True)),
            "outputs": dict(zip(linear.output_names, linear.y0.tolist(), strict=True)),
            **{name: getattr(linear, name).tolist() for name in "ABCD"},
        }
        write_whole(out, json_text(content))
        typer.echo(f"written to {out}")
    return 0
