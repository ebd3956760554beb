"""Closed-loop courses of several controllers over each other, on the full and the linear model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workbench.reports.style import INK, REFERENCE, colours, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """What is drawn of one controller's run.

    Args:
        controller: Name of the controller; sets the colour.
        time: Times, shape (n,), in s.
        output: Followed output of the full plant, shape (n,), in the unit of the picture.
        command: Command, shape (n,), in its unit.
        linear: Output of the linear model under the same controller, shape (n,); None if not run.

    Example:
        >>> Course("cascade PID", np.zeros(2), np.zeros(2), np.full(2, 5.0)).linear is None
        True
    """

    controller: str
    time: Vector
    output: Vector
    command: Vector
    linear: Vector | None = None


def tracking(
    time: npt.ArrayLike,
    reference: npt.ArrayLike,
    courses: Sequence[Course],
    *,
    quantity: str = "angle",
    unit: str = "°",
    command: str = "valve in V",
    error_limit: float | None = None,
) -> Figure:
    """Draw what several controllers did with one reference.

    Args:
        time: Times of the reference, shape (n,), in s.
        reference: Reference, shape (n,), in ``unit``.
        courses: What each controller did.
        quantity: The followed output, in a word.
        unit: Its unit as written.
        command: The command and its unit.
        error_limit: Steady error allowed, in ``unit``, drawn as lines about zero error.

    Returns:
        The figure: output, error and command over time in s.

    Example:
        >>> t = np.linspace(0.0, 1.0, 5)
        >>> figure = tracking(t, t, [Course("cascade PID", t, t, t)])
        >>> [axes.get_ylabel() for axes in figure.axes]
        ['angle in °', 'error in °', 'valve in V']
    """
    from matplotlib.lines import Line2D

    figure, (position, error, valve) = new_figure([2.2, 1.1, 1.0])
    t, wanted = np.asarray(time, dtype=float), np.asarray(reference, dtype=float)
    position.step(t, wanted, where="post", color=REFERENCE.light, linewidth=1.0)
    shades = colours(course.controller for course in courses)
    handles = []
    for course in courses:
        shade = shades[course.controller].light
        position.plot(course.time, course.output, color=shade, linewidth=1.5)
        held = wanted[np.clip(np.searchsorted(t, course.time, "right") - 1, 0, len(t) - 1)]
        error.plot(course.time, held - course.output, color=shade, linewidth=1.1)
        valve.step(course.time, course.command, where="post", color=shade, linewidth=0.9)
        if course.linear is not None:
            position.plot(course.time, course.linear, color=shade, linewidth=1.0, linestyle="--")
        handles.append(Line2D([], [], color=shade, linewidth=1.5, label=course.controller))
    if error_limit:
        for limit in (-error_limit, error_limit):
            error.axhline(limit, color=REFERENCE.light, linewidth=0.9, linestyle=":")
        # Right after a step the error is the step; what matters is whether it comes to rest.
        error.set_ylim(-5.0 * error_limit, 5.0 * error_limit)
    handles.append(Line2D([], [], color=REFERENCE.light, linewidth=1.0, label="reference"))
    if any(course.linear is not None for course in courses):
        handles += [
            Line2D([], [], color=INK.light, linewidth=1.5, label="full plant"),
            Line2D([], [], color=INK.light, linewidth=1.0, linestyle="--", label="linear model"),
        ]
    label(position, y=f"{quantity} in {unit}")
    label(error, y=f"error in {unit}")
    label(valve, x="time in s", y=command)
    key(position, columns=3, handles=handles)
    figure.align_ylabels()
    return figure


def pressures(courses: Mapping[str, tuple[Vector, Vector, Vector]]) -> Figure:
    """Draw the pressures of both muscles.

    Args:
        courses: Times in s and the two gauge pressures in Pa, shape (n,) each, by controller.

    Returns:
        The figure: pressures in bar over time in s.

    Example:
        >>> t = np.linspace(0.0, 1.0, 5)
        >>> figure = pressures({"cascade PID": (t, 3e5 + t, 3e5 - t)})
        >>> [axes.get_ylabel() for axes in figure.axes]
        ['muscle 1 in bar', 'muscle 2 in bar']
    """
    figure, (first, second) = new_figure([1.6, 1.6])
    shades = colours(courses)
    for name, (time, p1, p2) in courses.items():
        line: dict[str, Any] = {"color": shades[name].light, "linewidth": 1.2}
        first.plot(time, np.asarray(p1) / 1e5, label=name, **line)
        second.plot(time, np.asarray(p2) / 1e5, **line)
    label(first, y="muscle 1 in bar")
    label(second, x="time in s", y="muscle 2 in bar")
    key(first)
    figure.align_ylabels()
    return figure
