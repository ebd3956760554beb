"""The arm itself, moving: an animated drawing of a simulated run beside its live traces."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.plants.arm.drawing import arm_drawing
from workbench.reports.page import Moving, template
from workbench.reports.style import FURTHER, INK, SIMULATED, Colour
from workbench.simulation import Trajectory

Trace = tuple[str, tuple[tuple[Vector, Colour], ...]]
"""Quantity with its unit, and the curves that are drawn over time, with their colours."""

FRAME_TIME = 0.02
"""Time between frames, in s; the page draws between them."""

_WIDTH, _LEFT, _RIGHT = 374.0, 42.0, 6.0
_HEIGHT, _GAP = 62.0, 12.0
"""Size of the traces, in the units of their drawing."""


_DASHES_PER_VOLT_SECOND = 60.0


def moving_arm(run: Trajectory, *, start: float, stop: float, caption: str) -> Moving:
    """Draw a simulated run of the arm, from ``start`` to ``stop`` in s, as an animation.

    It plays without a network, has a button and a slider, and rests where the reader asks for
    reduced motion, on paper, and without scripts.
    """
    time = np.arange(start, stop + 0.5 * FRAME_TIME, FRAME_TIME)

    def of(name: str) -> Vector:
        return np.asarray(np.interp(time, run.time, run[name]))

    drawn = arm_drawing(run.model, of("angle"))
    values = {q.name: q.value for q in run.model.parameters}
    pressures = [1e-5 * of(f"pressure_{i}") for i in (1, 2)]
    frames: dict[str, Any] = {
        "angle": np.degrees(of("angle")),
        "arm": -np.degrees(drawn.direction),
        "spool": of("spool"),
        # How far the dashes of the hoses have moved: they run with the valve's opening.
        "moved": np.cumsum(_DASHES_PER_VOLT_SECOND * FRAME_TIME * of("spool")),
        "muscles": [
            {
                "turn": -np.degrees(m.direction),
                "length": 1e3 * m.length,
                "fibre": 1e3 * m.fibre,
                "width": 1e3 * m.diameter,
                "pressure": p,
            }
            for m, p in zip(drawn.muscles, pressures, strict=True)
        ],
    }
    traces: tuple[Trace, ...] = (
        ("angle in °", ((frames["angle"], SIMULATED),)),
        ("p in bar", tuple(zip(pressures, FURTHER, strict=False))),
        ("valve in V", ((of("valve"), INK),)),
    )
    data = {"step": FRAME_TIME, **_rounded(frames)}
    markup = template("workbench.demo", "moving_arm.html").render(
        drawn=drawn,
        frames=data,
        data=json.dumps(data, separators=(",", ":")),
        supply=1e-5 * values["supply_pressure"],
        levers=[_lever(m.end[0], drawn.direction[0]) for m in drawn.muscles],
        plates=round(values["load"]),
        degrees=lambda x: -np.degrees(x),
        colours=(FURTHER[0], FURTHER[1]),
        traces=[_drawn(trace, i) for i, trace in enumerate(traces)],
        width=_WIDTH,
        left=_LEFT,
        right=_WIDTH - _RIGHT,
        height=len(traces) * (_HEIGHT + _GAP) + 22,
        start=start,
        stop=stop,
    )
    return Moving(markup, caption)


def _lever(end: Vector, direction: float) -> str:
    """Return the end of a lever in mm on the arm as it lies along x, y downwards."""
    x, y = 1e3 * end
    cosine, sine = np.cos(direction), np.sin(direction)
    return f"{cosine * x + sine * y:.1f} {sine * x - cosine * y:.1f}"


def _rounded(frames: Any) -> Any:
    if isinstance(frames, dict):
        return {name: _rounded(value) for name, value in frames.items()}
    if isinstance(frames, list):
        return [_rounded(value) for value in frames]
    return np.round(frames, 2).tolist()


def _drawn(trace: Trace, row: int) -> dict[str, Any]:
    """Return signals as paths in the coordinates of the drawing."""
    label, curves = trace
    top = row * (_HEIGHT + _GAP) + 6
    low = min(float(values.min()) for values, _ in curves)
    high = max(float(values.max()) for values, _ in curves)
    room = 0.06 * (high - low) or 1.0
    low, high = low - room, high + room

    def height(value: Any) -> Any:
        return top + _HEIGHT * (high - value) / (high - low)

    paths = []
    for values, colour in curves:
        x = np.linspace(_LEFT, _WIDTH - _RIGHT, len(values))
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, height(values), strict=True))
        paths.append({"colour": colour, "points": points})
    ticks = [{"text": f"{v:g}", "y": height(v)} for v in _nice(low, high)]
    return {"label": label, "middle": top + _HEIGHT / 2, "paths": paths, "ticks": ticks}


def _nice(low: float, high: float) -> list[float]:
    """Return two to four round values between two ends."""
    from matplotlib.ticker import MaxNLocator

    found = MaxNLocator(nbins=3, steps=[1, 2, 3, 5, 10]).tick_values(low, high)
    return [float(v) for v in found if low <= v <= high]
