"""The arm itself, moving: an animated drawing of a simulated run beside its live traces."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.plants.arm.arm import ArmEquations
from workbench.plants.arm.geometry import TRAVEL, ArmGeometry
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


@dataclass(frozen=True)
class MusclePlaces:
    """Where one muscle is, over the angles of a drawing.

    Args:
        anchor: Its fixed end, x and y, in m.
        end: Its end on the lever, shape (n, 2), in m.
        fibre: Length of its fibres, shape (n,), in m; the rest is fittings.
        diameter: Diameter of its middle, shape (n,), in m.
    """

    anchor: tuple[float, float]
    end: Vector
    fibre: Vector
    diameter: Vector

    @property
    def length(self) -> Vector:
        """Distance of both ends, shape (n,), in m."""
        return np.asarray(np.hypot(*(self.end - self.anchor).T))

    @property
    def direction(self) -> Vector:
        """Direction from the anchor to the lever, counterclockwise from x, shape (n,), in rad."""
        x, y = (self.end - self.anchor).T
        return np.asarray(np.arctan2(y, x))


@dataclass(frozen=True)
class ArmDrawing:
    """The parts of an arm over the angles of a drawing.

    The pivot is the origin, the muscles lie along the negative x axis, and y points up. Half way
    between the stops the arm lies along the positive x axis; the angle turns it counterclockwise.

    Args:
        direction: Direction of the arm, counterclockwise from x, shape (n,), in rad.
        stops: Directions of the arm on its two stops, in rad.
        plates: Centre of the plates along and above the arm, in m.
        plate_width: Side of a plate, in m.
    """

    geometry: ArmGeometry
    muscles: tuple[MusclePlaces, MusclePlaces]
    direction: Vector
    stops: tuple[float, float]
    plates: tuple[float, float]
    plate_width: float


def arm_drawing(model: Model, angle: npt.ArrayLike) -> ArmDrawing:
    """Place the parts of an arm as its equations declare them, at angles of shape (n,), in rad."""
    equations: Any = model.equations
    if not isinstance(equations, ArmEquations):
        raise WorkbenchError(f"model {model.name!r} is no arm, so its drawing is unknown")
    geometry, body = equations.geometry, equations.body
    theta = np.atleast_1d(np.asarray(angle, dtype=float))
    places = [
        _muscle(equations, side, own, np.asarray(fibre))
        for side, own, fibre in zip(
            (1.0, -1.0), (theta, TRAVEL - theta), geometry.fibre_lengths(theta), strict=True
        )
    ]
    values = {q.name: q.value for q in model.parameters}
    middle = 0.5 * TRAVEL
    return ArmDrawing(
        geometry,
        (places[0], places[1]),
        theta - middle,
        (values["lower_stop"] - middle, values["upper_stop"] - middle),
        body.plate_centre,
        # A square plate has the inertia a^2 / 6 per mass about its own centre.
        float((6 * body.plate_inertia) ** 0.5),
    )


def _muscle(equations: ArmEquations, side: float, own: Vector, fibre: Vector) -> MusclePlaces:
    """Place a muscle: its lever is on one side of the axis, its anchor on the other."""
    g = equations.geometry
    end = np.column_stack([-g.lever * np.sin(own), side * g.lever * np.cos(own)])
    diameter = np.asarray(equations.laws.volume.diameter(fibre))
    return MusclePlaces((-g.anchor_distance, -side * g.anchor_offset), end, fibre, diameter)
