"""The verb ``simulate``."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

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
from workbench.errors import WorkbenchError, check_range
from workbench.model.units import quantity

COLUMNS = (
    ("time_s", "time", 1.0, "%.6g"),
    ("valve_V", "valve", 1.0, "%.6g"),
    ("angle_deg", "angle", 57.29577951308232, "%.6f"),
    ("pressure_1_bar", "pressure_1", 1e-5, "%.6f"),
    ("pressure_2_bar", "pressure_2", 1e-5, "%.6f"),
)
"""Columns of a written run: heading, signal, factor from SI, format."""


def simulate(
    valve: Annotated[
        list[str] | None,
        typer.Option(
            help="Valve voltage from a time on, such as 0:5.5 1.5:4.6; may be given several times.",
            metavar="TIME:VOLTAGE",
        ),
    ] = None,
    pulses: Annotated[
        str | None,
        typer.Option(help="Instead: pulses of this height about the centre.", metavar="VOLTAGE"),
    ] = None,
    period: Annotated[str, typer.Option(help="Period of the pulses.", metavar="TIME")] = "4s",
    duration: Annotated[str, typer.Option(help="Length of the run.", metavar="TIME")] = "8s",
    sample_time: Annotated[str, typer.Option(help="Time between samples.", metavar="TIME")] = "2ms",
    angle: Annotated[
        str, typer.Option(help="Angle at which the arm rests at the start.", metavar="ANGLE")
    ] = "30deg",
    load: Load = "3kg",
    plane: Plane = "horizontal",
    supply: Supply = "6bar",
    parameter: Parameters = None,
    without: Without = None,
    hysteresis: Hysteresis = False,
    out: Annotated[
        Path | None, typer.Option(help="CSV file for time, valve, angle and pressures.")
    ] = None,
) -> int:
    """Run the arm with a given valve voltage and say how far the result can be trusted.

    Examples: 'workbench simulate --valve 0:5.9 --valve 2:4.1',
    'workbench simulate --load 8kg --pulses 0.9V --out run.csv'.

    Args:
        valve: Steps of the valve voltage as TIME:VOLTAGE.
        pulses: Height of pulses instead, or None.
        period: Period of the pulses.
        duration: Length of the run.
        sample_time: Time between samples.
        angle: Angle at which the arm rests at the start.
        load: Mass of the plates, with or without its unit.
        plane: Plane of the motion.
        supply: Supply pressure, gauge, with or without its unit.
        parameter: Changed parameters as NAME=VALUE.
        without: Effects to leave out.
        hysteresis: Whether both muscles have hysteresis.
        out: CSV file, or None.

    Returns:
        Exit status.

    Example:
        >>> simulate(["0:12V"])
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: valve voltage is 12 V; the valid range is 0 to 10 V
    """
    import math

    from workbench.operating_point import operating_point
    from workbench.simulation import simulate as run_model

    model = plant_from_options(
        load,
        plane,
        supply,
        parameters=parameter or (),
        without=without or (),
        hysteresis=hysteresis,
    )
    step = check_range("sample time", quantity("sample time", sample_time, "s"), 1e-4, 0.02, "s")
    length = check_range("duration", quantity("duration", duration, "s"), 2 * step, 600.0, "s")
    voltage = _voltage(valve or (), pulses, period, length, step)
    start = math.radians(quantity("angle", angle, "deg"))
    point = operating_point(model, {"angle": start})
    run = run_model(model, voltage, sample_time=step, start=point.x)
    typer.echo(str(run))
    if out is not None:
        from workbench.files import write_whole

        write_whole(out, _csv(run))
        typer.echo(f"written to {out}")
    return 0


def _voltage(
    steps: Sequence[str], pulses: str | None, period: str, duration: float, sample_time: float
) -> Any:
    import numpy as np

    if pulses is not None:
        from workbench.trials.open_loop import pulse_train

        if steps:
            raise WorkbenchError("both --valve and --pulses are given; keep one of them")
        return pulse_train(
            amplitude_V=quantity("pulse height", pulses, "V"),
            period=quantity("period", period, "s"),
            duration=duration,
            sample_time=sample_time,
        )
    if not steps:
        raise WorkbenchError(
            "no valve voltage is given; give steps such as --valve 0:5.5, or --pulses 0.9"
        )
    points = sorted(_step(text) for text in steps)
    time = sample_time * np.arange(round(duration / sample_time))
    rank = np.searchsorted([t for t, _ in points], time + 1e-9, side="right") - 1
    values = np.array([v for _, v in points])
    return np.where(rank < 0, 5.0, values[np.maximum(rank, 0)])


def _step(text: str) -> tuple[float, float]:
    time, sign, voltage = text.partition(":")
    if not sign:
        raise WorkbenchError(f"valve step {text!r} has no voltage; write it as TIME:VOLTAGE")
    volt = quantity("valve voltage", voltage, "V")
    return (
        check_range("time of a valve step", quantity("time", time, "s"), 0.0, 600.0, "s"),
        check_range("valve voltage", volt, 0.0, 10.0, "V"),
    )


def _csv(run: Any) -> str:
    import numpy as np

    table = np.column_stack(
        [factor * (run.time if name == "time" else run[name]) for _, name, factor, _ in COLUMNS]
    )
    stream = io.StringIO()
    np.savetxt(
        stream,
        table,
        fmt=[form for *_, form in COLUMNS],
        delimiter=",",
        header=",".join(heading for heading, *_ in COLUMNS),
        comments="",
    )
    return stream.getvalue()
