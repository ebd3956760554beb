"""Linear analysis: loops with their margins and disk margins.

The controller's law is differentiated around rest (`controllers.linear_law`), on the linear model
by its command that is sampled with held inputs, so that filters, inner loops,
the observer and the delay of sampling all count. An MPC is its unconstrained law there, a sliding
mode the law inside its boundary layer.

Disk margin alpha: the largest disk of simultaneous changes of gain and phase that cannot make the
loop unstable, ``alpha = 1 / max |(S - T) / 2|``; gain margin ``(1 + alpha/2) / (1 - alpha/2)`` both
ways, phase margin ``2 atan(alpha / 2)``. Source: Seiler, Packard and Gahinet, An Introduction to
Disk Margins, IEEE Control Systems 40(5), 2020.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controllers.protocol import Controller, Measurement
from controllers.sensitivity import (
    LoopMatrices,
    down_to_slow,
    frequencies,
    gain_of,
    least_gain,
    loops_at,
    sensitivities_of,
    with_resonances,
)
from workbench.arrays import Complex, Vector
from workbench.errors import WorkbenchError
from workbench.files import picked
from workbench.linearisation import LinearModel, linear_model
from workbench.registry import user_code
from workbench.study.study import Study

_NO_RESPONSE = np.zeros(0), np.zeros(0, dtype=complex)


@dataclass(frozen=True)
class LoopAnalysis:
    """An opened loop at one operating point.

    Args:
        point: Given values of the operating point, by name, in SI.
        opened: Where the loop is opened: at a sensor, at a command, or at all outputs, and then at
            all commands, together.
        frequency_Hz: Frequencies, shape (n,), in Hz.
        response: Loop gain L, shape (n,), dimensionless; negative feedback is L / (1 + L).
        gain_margin: Smallest factor above 1 that makes it unstable; infinite if none does.
        gain_margin_down: Largest factor below 1 that makes it unstable; 0 if none does.
        phase_margin: In rad; infinite if the gain never crosses 1.
        crossover_Hz: Frequency of the phase margin, in Hz; NaN if there is none.
        delay_margin: Delay that makes it unstable, in s.
        sensitivity: Ms, the peak of ``1 / (1 + L)``, dimensionless.
        complementary: Mt, the peak of ``L / (1 + L)``, dimensionless.
        disk_margin: Disk margin alpha, dimensionless.
    """

    controller: str
    point: tuple[tuple[str, float], ...]
    opened: str
    frequency_Hz: Vector
    response: Complex
    stable: bool
    gain_margin: float = math.nan
    gain_margin_down: float = math.nan
    phase_margin: float = math.nan
    crossover_Hz: float = math.nan
    delay_margin: float = math.nan
    sensitivity: float = math.nan
    complementary: float = math.nan
    disk_margin: float = math.nan
    reason: str = ""
    command: bool = False

    @property
    def disk_gain_margin(self) -> float:
        """Factor by which the gain may rise or fall while the phase moves too."""
        half = self.disk_margin / 2
        return (1 + half) / (1 - half) if half < 1 else math.inf

    @property
    def disk_phase_margin(self) -> float:
        """Angle in rad by which the phase may move while the gain moves too."""
        return 2 * math.atan(self.disk_margin / 2)

    def table(self) -> dict[str, Any]:
        """Return the metrics as plain numbers, with units in their names."""
        return {"controller": self.controller, "point": dict(self.point)} | picked(
            self,
            "opened stable gain_margin gain_margin_down phase_margin_rad=phase_margin crossover_Hz"
            " delay_margin_s=delay_margin maximum_sensitivity=sensitivity"
            " maximum_complementary=complementary disk_margin reason",
        )


def analyse_loop(
    controller: Controller,
    linear: LinearModel,
    point: tuple[tuple[str, float], ...] = (),
    *,
    points: int = 600,
    every: bool = False,
    delay: float = 0.0,
) -> tuple[LoopAnalysis, ...]:
    """Open the loop at the first sensor and at the command, and compute its margins.

    Of several commands, it is opened at each controlled output and each command, all others
    closed, and at all of them together, at the commands alone where more is read than followed: the
    disk margin is then that of all changes at once, each of its own (see
    `controllers.sensitivity.least_gain`).

    Args:
        point: Given values of the operating point, by name, in SI, for the record.
        points: Number of frequencies up to 0.98 of the Nyquist frequency; beside them stand those
            of lightly damped modes, and below them those of a loop that is far slower.
        every: Whether it is opened at the other sensors too.
        delay: Time by which every command is late beside the sampling, in s.

    Returns:
        Analyses, the commands' behind the sensors', that of all together last; with a reason
        instead of numbers where the law has no linear form.

    Raises:
        WorkbenchError: If the linear model lacks a sensor or an actuator, or the law is not linear
            around rest.
    """
    linear = linear_model(linear)
    values = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    at_rest = tuple(values.get(name, 0.0) for name in controller.sensors)
    sizes = {q.name: q.scale for q in linear.operating_point.model.outputs}
    _check_linear(controller, at_rest, values, sizes.get(controller.sensors[0], 1.0))
    (loop,), h = loops_at(controller, linear, ((delay, 0.0),)), controller.sample_time
    angle = with_resonances(loop, down_to_slow(loop, frequencies(points)))
    sensors, commands = controller.sensors, controller.actuators
    shown = sensors if every else controller.controlled if len(commands) > 1 else sensors[:1]
    seen = [sensors.index(name) for name in shown if name in sensors]
    places = [*((sensors[k], k, 0) for k in seen), *((n, None, k) for k, n in enumerate(commands))]
    found = []
    hertz = angle / (2 * np.pi * h)
    for name, sensor, command in places:
        gain, stable = gain_of(loop, angle, sensor, command)
        own = _margins(controller.name, point, name, hertz, gain, stable)
        found.append(replace(own, command=sensor is None))
    if len(commands) > 1 and stable:
        more = len(sensors) > len(controller.controlled)
        found.append(_together(controller.name, point, loop, angle, more))
    return tuple(found)


def _together(
    name: str, point: tuple[tuple[str, float], ...], loop: LoopMatrices, angle: Vector, more: bool
) -> LoopAnalysis:
    """Return the peaks of a loop opened at all commands, and at all outputs, the worst of both.

    At outputs only if no more are read than followed: each of more is judged beside the others.
    """
    both = sensitivities_of(loop, angle)[1 if more else 0 :]
    s, t, half = (
        max(float(np.max(least_gain(S - share * np.eye(S.shape[1])))) for S in both)
        for share in (0.0, 1.0, 0.5)
    )
    found = LoopAnalysis(name, point, "all at once", *_NO_RESPONSE, True, command=True)
    return replace(found, sensitivity=s, complementary=t, disk_margin=1.0 / half)


def _check_linear(
    controller: Controller, at_rest: Measurement, values: Mapping[str, float], size: float
) -> None:
    """Refuse a law whose command grows unlike a small deviation of the first sensor."""
    state = controller.initial_state(at_rest)
    references = tuple(values[name] for name in controller.controlled) * (1 + controller.preview)

    def command(deviation: float) -> float:
        moved = (at_rest[0] + deviation, *at_rest[1:])
        return float(controller.linear_command(controller.step(state, moved, references)[0])[0])

    small = 1e-5 * max(abs(at_rest[0]), size)
    first = command(small) - command(-small)
    ratio = (command(4.0 * small) - command(-4.0 * small)) / first if first else 4.0
    # A root gives 2, a relay 1, a power of 1.5 gives 8; linear laws 4.00 with all their rounding.
    if not 3.9 < ratio < 4.1:
        raise WorkbenchError(
            f"the law is not linear around rest: four times the deviation gives {ratio:.2g} times"
            " the command, so margins would mean nothing"
        )


def _margins(
    name: str,
    point: tuple[tuple[str, float], ...],
    opened: str,
    frequency: Vector,
    loop: Complex,
    stable: bool,
) -> LoopAnalysis:
    of = (name, point, opened, frequency, loop)
    if not stable:
        return LoopAnalysis(*of, False, reason="the closed loop is unstable")
    s = 1.0 / (1.0 + loop)
    t = loop * s
    circle, at, axis, _ = crossings(frequency, loop)
    lag = np.mod(np.angle(circle) + math.pi, 2 * math.pi)
    phases = np.minimum(lag, 2 * math.pi - lag)
    least = int(np.argmin(phases)) if len(phases) else -1
    factors = -1.0 / axis.real
    return LoopAnalysis(
        *of,
        True,
        gain_margin=float(np.min(factors[factors > 1.0], initial=math.inf)),
        gain_margin_down=float(np.max(factors[factors < 1.0], initial=0.0)),
        phase_margin=float(phases[least]) if len(phases) else math.inf,
        crossover_Hz=float(at[least]) if len(phases) else math.nan,
        # A delay turns backwards: what it needs is the angle down to -180 degrees.
        delay_margin=float(np.min(lag / (2 * math.pi * at), initial=math.inf)),
        sensitivity=float(np.max(np.abs(s))),
        complementary=float(np.max(np.abs(t))),
        disk_margin=float(1.0 / np.max(np.abs((s - t) / 2.0))),
    )


def crossings(frequency: Vector, response: Complex) -> tuple[Complex, Vector, Complex, Vector]:
    """Find where a loop gain crosses the unit circle and the negative real axis.

    Args:
        frequency: Frequencies, shape (n,), in Hz, above 0.
        response: Loop gain, shape (n,), dimensionless.

    Returns:
        Loop gains on the unit circle and their frequencies in Hz, then those on the negative real
        axis and theirs.
    """

    def where(level: Vector) -> tuple[Complex, Vector]:
        at = np.flatnonzero(level[:-1] * level[1:] < 0.0)
        part = level[at] / (level[at] - level[at + 1])
        found = response[at] + part * (response[at + 1] - response[at])
        return found, frequency[at] * (frequency[at + 1] / frequency[at]) ** part

    circle, at_circle = where(np.log(np.maximum(np.abs(response), 1e-300)))
    axis, at_axis = where(response.imag)
    left = axis.real < 0.0
    return circle, at_circle, axis[left], at_axis[left]


def analyse_study(study: Study) -> tuple[LoopAnalysis, ...]:
    """Open the loops of every controller of a study at its operating points."""
    found: list[LoopAnalysis] = []
    # What is late in every scenario is late in the loop.
    late = min((s.late_samples * s.sample_time for s in study.scenarios.values()), default=0.0)
    for recipe in study.controllers.values():
        for point in study.points:
            try:
                with user_code("linear analysis"):
                    found += analyse_loop(recipe.build(), recipe.linear(point), point, delay=late)
            # Own controllers may have any state; what cannot be linearised is told, not fatal.
            except WorkbenchError as error:
                reason = " ".join(str(error).removeprefix("linear analysis failed: ").split())
                nothing = LoopAnalysis(recipe.name, point, "", *_NO_RESPONSE, False)
                found.append(replace(nothing, reason=reason))
    return tuple(found)
