"""The arm itself, moving: an animated drawing of a simulated run beside its live traces."""

from __future__ import annotations

import json
from collections.abc import Sequence
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
from workbench.reports.pictures import Picture, inline_svg
from workbench.reports.style import FURTHER, INK, SIMULATED, label, new_figure
from workbench.simulation import Trajectory

FRAME_TIME = 0.02
"""Time between frames, in s; the page draws between them."""

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
    traces, left, right = _traces(time, frames["angle"], pressures, of("valve"))
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
        traces=traces,
        left=round(left, 3),
        right=round(right, 3),
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


def _traces(
    time: Vector, angle: Vector, pressures: Sequence[Vector], valve: Vector
) -> tuple[str, float, float]:
    """Draw the signals over time; returns the drawing, and where its axis begins and ends, in %."""
    figure, panels = new_figure([0.75] * 3)
    rows = (
        ("angle in °", [angle], (SIMULATED,)),
        ("p in bar", pressures, FURTHER),
        ("valve in V", [valve], (INK,)),
    )
    for axes, (name, curves, colours) in zip(panels, rows, strict=True):
        for values, colour in zip(curves, colours, strict=False):
            axes.plot(time, values, color=colour.light, linewidth=1.4)
        label(axes, y=name)
    label(panels[-1], x="time in s")
    drawn = inline_svg(Picture("traces", figure, "angle, pressures and valve voltage over time"))
    # Where the axes are is known once they are drawn.
    place = panels[0].get_position()
    return drawn, 100.0 * place.x0, 100.0 * place.x1


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
