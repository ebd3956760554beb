"""The verb ``simulate``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from workbench.cli.plant import Chosen, with_plant
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_range
from workbench.files import write_whole

if TYPE_CHECKING:
    from workbench.arrays import Vector
    from workbench.model import Model, State
    from workbench.simulation import Trajectory

_LEAST_SAMPLES = 200
"""Samples that a run has at least, where nobody says how long one is."""

_MORE, _MOST = 50, 2e6
"""How many times more samples a run may have to meet the instants at which inputs switch, and the
most parts of a run between which they can."""


@with_plant("option", "effect", "input", "at")
def simulate(
    chosen: Chosen,
    *,
    pulses: str | None = None,
    period: str | None = None,
    duration: str | None = None,
    sample_time: str | None = None,
    initial: bool = False,
    out: Path | None = None,
) -> None:
    """Run a plant with given inputs, from rest, and say how far the result can be trusted.

    A plant that does not rest with its nominal inputs starts at the initial values of its states.

    Examples: 'workbench simulate --valve 0:5.9 --valve 2:4.1',
    'workbench simulate --load 8kg --pulses 0.9V --out run.csv',
    'workbench simulate --plant my_plants:circuit --input voltage=0:5,1ms:0 --duration 10ms
    --sample-time 10us'.

    Args:
        pulses ([NAME=]HEIGHT): Instead: pulses of this height about the nominal value of the first
            input, or of one that is named, such as 0.9 or valve=0.9V.
        period (TIME): Period of the pulses. By default two steps that the linear model responds to.
        duration (TIME): Length of the run. By default four such steps, and two after the last time
            at which an input switches.
        sample_time (TIME): Time between samples. By default a thousandth of such a step, less where
            a run would have less than 200 of them or inputs would switch between two.
        initial: Start at the initial values that the states declare, not at rest.
        out: CSV file for time, inputs and outputs.
    """
    from workbench.linearisation import linearise
    from workbench.linearisation.time_scales import step_time
    from workbench.model.units import quantity
    from workbench.operating_point import operating_point
    from workbench.recordings.column_matching import check_own_columns
    from workbench.simulation import simulate as run_model

    if initial and chosen.at:
        raise WorkbenchError("both --initial and a value at rest are given; keep one of them")
    model = chosen.model
    if out is not None:
        check_own_columns(model)
    u = model.nominal_input
    x = model.initial_state(u=u)
    try:
        start = operating_point(model, chosen.design_point)
    except WorkbenchError as error:
        if chosen.at or duration is None or (pulses is not None and period is None):
            raise
        start, unrest = None, str(error)
    declared = x
    if start is not None and not initial:
        x, u = start.x, start.u

    def time(name: str, given: str | None, steps: float) -> float:
        if given is not None:
            return quantity(name, given, "s")
        if start is None:
            return 1e-3 * quantity("duration", str(duration), "s")
        return steps * step_time(linearise(start, verdict=False))

    step, length = time("sample time", sample_time, 1e-3), time("duration", duration, 4.0)
    if duration is None:
        last = max((t for steps in chosen.inputs.values() for t, _ in steps), default=0.0)
        length = max(length, last + 0.5 * length)
    if sample_time is None and length > 0.0:
        # A slow mode, or a rest that is far from where it starts, is no reason to refuse a time.
        step = length / max(_LEAST_SAMPLES, math.ceil(length / step - 1e-9))
    step = check_range("sample time", step, *TIMES_S, "s")
    check_range("duration", length, 2 * step, 1e6 * step, "s")
    driven = _with_pulses(chosen, pulses, lambda: time("period", period, 2.0), length)
    instants = sorted({t for steps in driven.values() for t, _ in steps if 0.0 < t < length})
    step, parts = _paced(instants, step, length, given=sample_time is not None)
    fine = step / parts
    run = run_model(model, _held(model, u, driven, length, fine), sample_time=fine, start=x)
    if start is None:
        typer.echo(f"{unrest}; it starts at the initial values of its states", err=True)
    elif not initial and not chosen.at:
        _tell_other_start(model, declared, start.x)
    typer.echo(str(run))
    if out is not None:
        write_whole(out, _csv(run, parts))
        if parts > 1:
            typer.echo("inputs switch between its samples; a shorter --sample-time shows where")
        typer.echo(f"simulated recording written to {out}")


def _paced(
    instants: Sequence[float], step: float, length: float, *, given: bool
) -> tuple[float, int]:
    """Return a sample time, and into how many parts a sample is cut for inputs to switch between.

    Args:
        instants: When inputs switch, in s.
        step: Sample time, in s, which is kept if it was given.
        length: Length of the run, in s.
    """
    common = 0.0
    for instant in instants:
        common = _divisor(common, instant, 1e-6 * step)
    if not given and common > step / _MORE:
        # A little less or much less, so that one sample is at each of them.
        return common / math.ceil(common / step - 1e-9), 1
    common = _divisor(common, step, 1e-6 * step) if instants else step
    return step, min(round(step / common), math.ceil(_MOST * step / length))


def _divisor(a: float, b: float, tolerance: float) -> float:
    """Return the largest time of which two are multiples, but for a tolerance (Euclid)."""
    while a > tolerance:
        a, b = b - a * round(b / a), a
        a = abs(a)
    return b


def _tell_other_start(model: Model, initial: Vector, rest: Vector) -> None:
    """Say which states that declare where they start do not start there, being at rest."""
    from workbench.model.quantities import shown_in
    from workbench.model.units import from_si, with_unit

    def shown(q: State, value: float) -> str:
        return with_unit(f"{float(from_si(value, shown_in(q))):.4g}", shown_in(q))

    moved = [
        f"{q.name} {shown(q, x)} for {shown(q, own)}"
        for q, own, x in zip(model.states, initial, rest, strict=True)
        if q.initial and abs(own - x) > 1e-3 * q.scale
    ]
    if moved:
        typer.echo(
            f"it starts at rest, not at the initial values of its states ({', '.join(moved)}):"
            " --initial starts there",
            err=True,
        )


def _with_pulses(
    chosen: Chosen, pulses: str | None, period: Callable[[], float], duration: float
) -> dict[str, tuple[tuple[float, float], ...]]:
    from workbench.model.units import of_difference, parse_unit, quantity

    model = chosen.model
    known = {q.name: q for q in (*model.commands, *model.inputs)}
    driven = dict(chosen.inputs)
    if pulses is None:
        if not driven and known:
            name = next(iter(known))
            raise WorkbenchError(
                f"no input is given; give steps of {', '.join(known)}, such as"
                f" --{name.replace('_', '-')} 0:1, or --pulses 1"
            )
        return driven
    if not known:
        raise WorkbenchError(f"{chosen.model.name!r} has no input to pulse; leave out --pulses")
    name, sign, height = pulses.rpartition("=")
    name = name.replace("-", "_") if sign else next(iter(known))
    check_choice("input", name, known)
    if name in driven:
        raise WorkbenchError(f"both --{name} and --pulses are given; keep one of them")
    about, word = known[name], name.replace("_", " ")
    unit = of_difference(about.display_unit)
    factor = parse_unit(unit).factor
    above, below = about.upper - about.nominal, about.nominal - about.lower
    # What rests on its bound, as a heater that is off, is pulsed from there.
    room = (min(above, below) or max(above, below)) / factor
    given = quantity("pulse height", height, unit, difference=True)
    size = factor * check_range(f"pulse height of {word}", given, 0.0, room, unit)
    half = 0.5 * check_range("period", period(), *TIMES_S, "s")
    count = int(duration / half) + 1
    driven[name] = tuple(
        (i * half, about.nominal + (min(size, above) if i % 2 == 0 else -min(size, below)))
        for i in range(count)
    )
    return driven


def _held(
    model: Model,
    rest: Vector,
    driven: dict[str, tuple[tuple[float, float], ...]],
    duration: float,
    sample_time: float,
) -> Any:
    """Return the samples of all inputs; one that is not driven stays as the plant rests."""
    count = round(duration / sample_time)
    held = np.tile(rest, (count, 1))
    number = np.arange(count)
    for i, quantity in enumerate(model.inputs):
        for time, value in driven.get(quantity.name, ()):
            held[number >= round(time / sample_time), i] = value
    return held


def _csv(run: Trajectory, parts: int) -> str:
    """Return time, inputs and outputs at the samples of a run that has parts of each."""
    from workbench.recordings.saving import csv_text

    outputs = {q.name for q in run.model.outputs}
    shown = [(q.name, q.display_unit) for q in run.model.inputs if q.name not in outputs]
    shown += [(q.name, q.display_unit) for q in run.model.outputs]
    return csv_text(run.time[::parts], [(name, unit, run[name][::parts]) for name, unit in shown])
