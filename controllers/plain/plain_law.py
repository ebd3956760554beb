"""A plain law: commands within ends, slews and curves, references at a pace.

Units: SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

from controllers.arithmetic import Arithmetic, Number, Numbers, Told
from controllers.law import ClosedForm, Kernel
from controllers.linear_law import LinearLaw
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.reference.paced import paced
from controllers.valve_inverse import ValveInverse


@dataclass(frozen=True, kw_only=True, repr=False)
class PlainLaw(ClosedForm):
    """A law in closed form from measurements to commands, within their ends and slews.

    Each reference is that of the measurement in its place; further measurements have none.

    Args:
        slew: Fastest changes of the commands, in SI per s.
        curves: What bends each command, or None: it is reckoned with as what does as much by the
            slope at rest, and so are its ends unless a lag stands before the curve; none by
            default.
        fading: What that lag leaves after a sample, a ratio, 0 for none. Through it a change w of
            the command's state moves to a w + (1 - a) v, and what makes the curve do so is sent.
        pace: Largest changes of the references that are followed, in SI of the outputs per sample.
        brake: Largest changes of these changes from one sample to the next, in SI of the outputs.
        leap: Changes of the references that need no brake, in SI of the outputs per sample; none
            by default.
    """

    sensors: tuple[str, ...]
    controlled: tuple[str, ...]
    actuators: tuple[str, ...]
    sample_time: float = 0.002
    rest: tuple[float, ...]
    rest_output: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    slew: tuple[float, ...] = ()
    curves: tuple[ValveInverse | None, ...] = ()
    fading: tuple[float, ...] = ()
    pace: tuple[float, ...] = ()
    brake: tuple[float, ...] = ()
    leap: tuple[float, ...] = ()
    preview: int = 0
    name: str = "plain"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the kernel out: another process makes its own."""
        return {name: own for name, own in vars(self).items() if name != "_kernel"}

    @cached_property
    def _kernel(self) -> Kernel:
        return Kernel(self)

    def step(
        self, state: Any, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any, Info]:
        return self._kernel(state, measurement, reference)

    def deviations(self, values: Numbers) -> Numbers:
        """Return measurements or references, in SI, as deviations from rest."""
        # There may be fewer references than measurements.
        return tuple(v - rest for v, rest in zip(values, self.rest_output, strict=False))

    def followed(
        self, before: Numbers | None, reference: Numbers, a: Arithmetic
    ) -> tuple[Numbers, Numbers | None]:
        """Return references at their pace, deviations in SI, and what the next sample needs."""
        asked = self.deviations(reference)
        if before is None:
            return asked, None
        p, none = len(asked), (math.inf,) * len(asked)
        limits = zip(self.pace or none, self.brake or none, self.leap or (0.0,) * p, strict=True)
        moved = tuple(
            paced(r - b, v, *own, a)
            for r, b, v, own in zip(asked, before[:p], before[p:], limits, strict=True)
        )
        now = tuple(b + v for b, v in zip(before, moved, strict=False))
        return now, (*now, *moved)

    def applied(self, before: Numbers | None, asked: Numbers, a: Arithmetic) -> Numbers:
        """Return commands between their ends, from what is kept of the sample before, in SI."""
        ends = list(zip(self.lower, self.upper, strict=True))
        if before is None:
            return tuple(a.clip(u, *end) for u, end in zip(asked, ends, strict=True))
        h, found = self.sample_time, []
        slews = self.slew or (math.inf,) * len(asked)
        for k, (b, u, end, slew) in enumerate(zip(before, asked, ends, slews, strict=True)):
            if self.fading and self.fading[k]:
                sent = self._through(k, b, u, a)
                ended = a.clip(sent, *end)
                found.append(a.where(ended == sent, u, self._back(k, b, ended, a)))
            else:
                within = a.clip(u, *end)
                found.append(
                    b + a.clip(within - b, -h * slew, h * slew) if slew < math.inf else within
                )
        return tuple(found)

    def _through(self, k: int, before: Number, command: Number, a: Arithmetic) -> Number:
        """Return what is sent so that what lags moves as by a command along a straight line."""
        curve, left = cast(ValveInverse, self.curves[k]), self.fading[k]
        after = left * before + (1.0 - left) * command
        now, then = (curve.command(v - curve.centre, a) for v in (before, after))
        return now + (then - now) / (1.0 - left)

    def _back(self, k: int, before: Number, sent: Number, a: Arithmetic) -> Number:
        """Return the command along a straight line by which what lags moves as by what is sent."""
        curve, left = cast(ValveInverse, self.curves[k]), self.fading[k]
        now = curve.command(before - curve.centre, a)
        after = curve.straight(now + (1.0 - left) * (sent - now), a)
        return before + (after - before) / (1.0 - left)

    def sent(self, before: Numbers | None, commands: Numbers, a: Arithmetic) -> Numbers:
        """Return what of commands is sent, in SI, through the inverses of their curves."""
        if not self.curves:
            return commands
        return tuple(
            u
            if curve is None
            else self._through(k, cast(Numbers, before)[k], u, a)
            if self.fading and self.fading[k]
            else curve.command(u - curve.centre, a)
            for k, (u, curve) in enumerate(zip(commands, self.curves, strict=True))
        )

    def resting(self, references: Numbers) -> Numbers | None:
        """Return what is remembered of references, in SI, that have been there for long."""
        limits = (*self.pace, *self.brake)
        ended = bool(limits) and min(limits) < math.inf
        return (*references, *(0.0 for _ in references)) if ended else None

    def kept(self, before: Numbers | None, commands: Numbers) -> Numbers | None:
        """Return what of commands, in SI, the next sample needs."""
        if not (self.slew and min(self.slew) < math.inf) and not any(self.fading):
            return None
        if before is None or not any(self.fading):
            return commands
        rows = zip(self.fading, before, commands, strict=True)
        return tuple(left * b + (1.0 - left) * u if left else u for left, b, u in rows)

    def told(self, asked: Numbers) -> Told:
        """Tell the commands before their ends, in SI."""
        return {f"asked.{name}": u for name, u in zip(self.actuators, asked, strict=True)}

    @property
    def rest_command(self) -> Command:
        """Commands at rest, in SI."""
        return self.rest

    def around_rest(self) -> LinearLaw:
        """Return the law between its ends, from measurements and references as deviations."""
        raise NotImplementedError

    def straight(self, told: Told) -> Numbers:
        """Return the commands before their ends, in SI."""
        return tuple(told[f"asked.{name}"] for name in self.actuators)

    def linear_command(self, command: Command) -> Command:
        """Return what does as much by the slopes at rest."""
        pairs = zip(command, self.curves or (None,) * len(command), strict=True)
        return tuple(u if c is None else c.straight(u) for u, c in pairs)
