"""Linear analysis of controllers: Bode, Nyquist and margins at several operating points."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from controllers.plain.loop import loop_of
from controllers.plain.pairing import interaction
from workbench.errors import WorkbenchError
from workbench.linearisation.operating_map import operating_map
from workbench.linearisation.time_scales import horizon_of
from workbench.linearisation.transfer import frequency_response, with_modes, zeros_of
from workbench.model.units import in_time, parse_unit, per
from workbench.reports.figure import Figure
from workbench.reports.figures.bode_nyquist import bode, nyquist
from workbench.reports.figures.study_traces import output_of, point_text, shown, written
from workbench.reports.page import Block, Words, methods
from workbench.reports.pictures import Picture
from workbench.reports.style import REFERENCE, SIMULATED, label, new_figure
from workbench.reports.tables import Cell, Table, number
from workbench.study.margins import LoopAnalysis
from workbench.study.study import Study

MAP_POINTS = 30
"""Points at which the plant is drawn over the axis of its map."""


def linear_blocks(study: Study, loops: tuple[LoopAnalysis, ...]) -> list[Block]:
    """Show the plant, the opened loops and their margins; nothing without loops."""
    if not loops:
        return []
    blocks: list[Block] = [
        Words(
            "The same controller objects on the linear models of their operating points, each loop "
            "opened at the measured output. The shaded disk is the one of the smallest disk margin "
            "of these loops."
        ),
        *plant_picture(study),
        *map_picture(study),
        *_together(study),
    ]
    for index, name in enumerate(dict.fromkeys(a.controller for a in loops), start=1):
        own = [a for a in loops if a.controller == name]
        outer = [a for a in own if a.opened and not a.command]
        # A loop that nothing passes has no magnitude that a logarithm could show.
        if not any(np.any(np.abs(a.response) > 0.0) for a in outer):
            continue
        places = list(dict.fromkeys(a.opened for a in outer))
        # Each loop has frequencies about its own resonances.
        told = [a for a in outer if len(a.frequency_Hz)]
        frequency = np.unique(np.concatenate([a.frequency_Hz for a in told]))
        curves = {
            ", ".join(
                part for part in (a.opened * (len(places) > 1), point_text(study, a.point)) if part
            ): np.interp(frequency, a.frequency_Hz, a.response)
            for a in told
        }
        margins = [a.disk_margin for a in outer if a.stable]
        loop_gain = bode(frequency, curves, unit="1", quantity="loop gain", margins=True)
        blocks += [
            Words(_sentence(study, name, own)),
            Picture(
                f"bode-{index}",
                loop_gain,
                f"{name}: loop gain, opened at {' or '.join(places)}. Marked: the gain"
                " margin, from the dot to 1, and the phase margin, from the dot to −180° or an"
                " odd multiple of it.",
                f"Bode plot of the loop gain of {name}",
            ),
            Picture(
                f"nyquist-{index}",
                nyquist(curves, disk_margin=min(margins, default=None)),
                f"{name}: the same in the complex plane; dotted the unit circle, + the point −1,"
                " dots where the margins are.",
                f"Nyquist plot of the loop gain of {name}",
            ),
        ]
    blocks.append(margin_table(study, loops))
    return blocks


def _together(study: Study) -> list[Words]:
    """Say what several followed outputs mean to each other, at every operating point."""
    recipe = next(iter(study.controllers.values()))
    asked = next(iter(study.scenarios.values())).references
    found = []
    for point in study.points:
        # What cannot be followed together was told where it was designed.
        with suppress(WorkbenchError):
            linear = recipe.linear(point)
            followed = [name for name in linear.output_names if name in asked]
            said = interaction(loop_of(linear, followed)) if len(followed) > 1 else []
            where = point_text(study, point)
            text = ". ".join(one[:1].upper() + one[1:] for one in said)
            found += [Words(f"The plant{f' at {where}' * bool(where)}. {text}.")] if said else []
    return found


def _sentence(study: Study, name: str, own: list[LoopAnalysis]) -> str:
    stable = [a for a in own if a.stable]
    if len(stable) < len(own):
        where = ", ".join(dict.fromkeys(point_text(study, a.point) for a in own if not a.stable))
        return f"{name}: no margins{f' at {where}' * bool(where)}; the table says why."
    least = min(stable, key=lambda a: a.disk_margin)
    late = min((a for a in stable if not math.isnan(a.delay_margin)), key=lambda a: a.delay_margin)
    near, slow = (
        f" at {text}," if (text := point_text(study, a.point)) else "" for a in (least, late)
    )
    said = (
        f"{name}: the smallest disk margin is {number(least.disk_margin, 2)},{near} opened at"
        f" {least.opened}; "
    )
    if math.isinf(late.delay_margin):
        return f"{said}{delay_words(late.delay_margin)}."
    return (
        f"{said}the smallest delay margin is {in_time(late.delay_margin, 2)},{slow} opened at"
        f" {late.opened}."
    )


def delay_words(margin: float) -> str:
    """Write a delay margin, in s.

    Example:
        >>> delay_words(0.0123), delay_words(math.inf)
        ('delay margin 12.3 ms', 'no delay makes it unstable')
    """
    return f"delay margin {in_time(margin)}" if margin < math.inf else "no delay makes it unstable"


def plant_picture(study: Study) -> list[Picture]:
    """Draw the plant's own frequency response at the operating points of a study."""
    recipe = next(iter(study.controllers.values()))
    controlled = next(iter(next(iter(study.scenarios.values())).references))
    quantity = output_of(study, controlled)
    models = {point_text(study, point): recipe.linear(point) for point in study.points}
    for linear in models.values():
        if len(linear.input_names) != 1 or controlled not in linear.output_names:
            return []
    times = [horizon_of(linear) for linear in models.values()] or [1.0]
    frequency = np.geomspace(0.05 / max(times), 50.0 / min(times), 400)
    roots = [
        np.append(m.poles, zeros_of(m.A, m.B[:, 0], m.C[m.output_names.index(controlled)]))
        for m in models.values()
    ]
    frequency = with_modes(frequency, np.concatenate(roots) / (2.0 * math.pi))
    driven = study.plant.build().inputs[0]
    factor = parse_unit(quantity.display_unit).factor / parse_unit(driven.display_unit).factor
    curves = {
        point: frequency_response(linear, controlled, frequency) / factor
        for point, linear in models.items()
    }
    unit = written(per(quantity.display_unit, driven.display_unit))
    return [
        Picture(
            "plant-bode",
            bode(frequency, curves, unit=unit),
            f"The plant alone: from {driven.name} to {controlled}, at every operating point.",
            "Bode plot of the plant",
        )
    ]


def map_picture(study: Study) -> list[Picture]:
    """Draw how the nominal plant changes over the first axis of the map that it declares.

    There is nothing to draw if that is no output, the plant has several inputs, or it rests
    nowhere.
    """
    model = study.plant.build()
    output, grid = next(iter(study.plant.plant().design_map.items()), ("", ()))
    if output not in [q.name for q in model.outputs] or len(model.inputs) != 1:
        return []
    values = np.linspace(grid[0], grid[-1], MAP_POINTS)
    try:
        found = operating_map(model.without(*model.dry_effects), {output: values}, input="plant")
    except WorkbenchError:
        return []
    # That of the gain: above slow drifts, a quarter of the oscillation.
    hertz = float(f"{0.5 / np.median([horizon_of(m) for m in found.models.values()]):.2g}")
    gain = found.table(lambda linear: abs(frequency_response(linear, output, [hertz])[0]))
    quantity, driven = output_of(study, output), model.inputs[0]
    factor, unit = parse_unit(quantity.display_unit).factor, written(quantity.display_unit)
    size = parse_unit(driven.display_unit).factor / factor
    gain_unit = written(per(quantity.display_unit, driven.display_unit))
    points = [v for point in study.points for n, v in point if n == output]
    figure, panels = new_figure([1.15, 1.15, 1.15])
    for axes, curve, title in (
        (panels[0], found.frequency_hz, "frequency in Hz"),
        (panels[1], found.damping, "damping ratio"),
        (panels[2], gain * size, f"gain in {gain_unit}"),
    ):
        # Points, for a line would make a slope of every jump at a corner of a law.
        axes.plot(shown(values, quantity), curve, "o", color=SIMULATED.light, markersize=3.5)
        for value in shown(points, quantity):
            axes.axvline(value, color=REFERENCE.light, linewidth=1.0, linestyle=":")
        # From zero, so that a change of one per cent does not look like a doubling.
        axes.set_ylim(0.0, 1.15 * float(np.nanmax(curve)))
        label(axes, y=title)
    name = output.replace("_", " ")
    label(panels[-1], x=f"{name} in {unit}")
    caption = (
        f"The plant alone over its {name}: frequency and damping of its oscillation, and the gain "
        f"from {driven.name.replace('_', ' ')} to {name} at {hertz:g} Hz, with jumps where"
        " a law of the plant has a corner. Dotted: the operating points."
    )
    return [Picture("plant-map", figure, caption, f"frequency, damping and gain over the {name}")]


def margin_table(study: Study, loops: tuple[LoopAnalysis, ...]) -> Table:
    """List the margins of all loops."""
    head = ("controller", "at", "opened at", "crossover", "gain (down)", "phase", "delay")
    return Table(
        "Margins",
        (*head, "Ms", "Mt", "disk: gain, phase"),
        tuple(
            (a.controller, point_text(study, a.point), a.opened or "–", *_margins(a)) for a in loops
        ),
        "Opened at the controlled output, inner loops stay closed; at the command, everything "
        "opens; of several, the others stay closed, and all at once are opened at all outputs, or "
        "at all commands. Gain: factor that makes the loop unstable (down: a factor below 1). "
        "Ms, Mt: peaks of the sensitivity 1/(1 + L) and of L/(1 + L). Disk: margin, and the factor "
        "and the phase by which both may change together.",
    )


def _margins(a: LoopAnalysis) -> tuple[Cell | str, ...]:
    """Return crossover, gain, phase and delay, Ms, Mt and the disk margin of a loop."""
    if a.reason:
        return (Cell("none", "missed", a.reason), *("",) * 6)
    down = f" ({number(a.gain_margin_down, 2)})" if a.gain_margin_down > 0 else ""
    known = a.delay_margin < math.inf
    # Loops that are opened together have no single gain.
    alone = (
        number(a.crossover_Hz, 2, unit="Hz"),
        number(a.gain_margin, 3) + down,
        number(math.degrees(a.phase_margin), 2) + "°",
        in_time(a.delay_margin, 2) if known else number(a.delay_margin),
    )
    disk = (
        f"{number(a.disk_margin, 2)}: × {number(a.disk_gain_margin, 2)}, "
        f"{number(math.degrees(a.disk_phase_margin), 2)}°"
    )
    single = alone if len(a.response) else ("",) * 4
    return (*single, number(a.sensitivity), number(a.complementary), disk)


LINEAR = Figure(
    "linear",
    lambda result: linear_blocks(result.study, result.loops),
    title="Linear analysis",
    order=40,
    methods=methods("linear"),
)
