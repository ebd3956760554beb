"""Laws written once for floats and for symbols: the step, its linear form and its text as C.

A controller in closed form states its `ClosedForm.law` with an `Arithmetic`. From the same text
come the step in Python, its linear form (derivatives of the expressions, `controllers.linear_law`)
and the step in C.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import casadi as ca
import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Told
from controllers.c_source import CSource, closed_form, traced
from controllers.protocol import Command, Info, Measurement, Reference
from workbench.computing.buffered import Buffered
from workbench.display import Rows, Shown


class ShownLaw(Shown):
    """A controller, a dataclass, that lists its numbers; of a matrix it says the size.

    Example:
        >>> from controllers.pid import cascade_pid
        >>> cascade_pid(6e5, 2e6, 1e5, inner=2e-6)
        <cascade PID: angle, pressure_1, pressure_2 -> valve every 2 ms>
    """

    def tables(self) -> tuple[Rows, ...]:
        """Return the numbers by name, in SI."""
        return (Rows("numbers in SI", ("name", "value"), list(_numbers("", self))),)

    def __str__(self) -> str:
        law: Any = self
        ways = f"{', '.join(law.sensors)} -> {', '.join(law.actuators)}"
        head = f"{law.name}: {ways} every {1e3 * law.sample_time:g} ms"
        return "\n".join([head, *(f"  {name:<36} {v}" for name, v in _numbers("", self))])


def _numbers(name: str, value: Any) -> Iterator[tuple[str, object]]:
    dot = f"{name}." if name else ""
    if isinstance(value, (bool, int, float, str, np.number)):
        yield name, value
    elif isinstance(value, np.ndarray):
        yield name, f"array of {' x '.join(map(str, value.shape))}"
    elif is_dataclass(value):
        for field in fields(value):
            yield from _numbers(f"{dot}{field.name}", getattr(value, field.name))
    elif hasattr(value, "_fields"):
        for part in value._fields:
            yield from _numbers(f"{dot}{part}", getattr(value, part))
    elif isinstance(value, tuple) and all(isinstance(v, str) for v in value):
        yield name, ", ".join(value)
    elif isinstance(value, (tuple, list)):
        yield name, f"{len(value)} entries"


class ClosedForm(ShownLaw):
    """A law of numbers, written once for floats and for symbols."""

    def initial_state(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> Any:
        """Return the state from which the law starts without a bump at a plant at rest."""
        raise NotImplementedError

    def law(
        self, state: Any, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, Any, Told]:
        """Compute one sample on floats or on symbols, in SI.

        Returns:
            Command, next state, and what is told about the step.
        """
        raise NotImplementedError

    def straight(self, told: Told) -> Numbers:
        """Return the command for a linear model, in SI, from what is told about a step."""
        raise NotImplementedError

    def step(
        self, state: Any, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any, Info]:
        """Compute the command of one sample."""
        return self.law(state, measurement, reference, FLOATS)

    def linear_law(
        self,
        state: Any,
        measurement: Numbers,
        reference: Numbers,
        arithmetic: Arithmetic,
        rest: Measurement,
    ) -> tuple[Numbers, Any]:
        """Return command for a linear model and next state, as `controllers.linear_law` asks."""
        _, following, told = self.law(state, measurement, reference, arithmetic)
        return self.straight(told), following

    def c_source(self, name: str) -> CSource:
        """Write the law as C."""
        return closed_form(self, name)


class Kernel:
    """The step of a law whose state is a named tuple of tuples, or of None, traced once.

    Ten times as fast as the text of a law with many states. Where anything is not finite it is the
    text that runs: symbols take another branch there.
    """

    def __init__(self, law: ClosedForm) -> None:
        one = traced(law)
        self._law, self._kind, self._names = law, type(one.begin), tuple(one.told)
        told = [ca.SX(value) for value in one.told.values()]
        entering = ca.vertcat(one.entries, one.measurement, one.reference)
        leaving = ca.vertcat(one.following, one.command, *told)
        self._called = Buffered(ca.Function("step", [entering], [ca.densify(leaving)]))
        self._arguments = self._called.arguments[0].data
        self._results = self._called.results[0].data
        self._packed, self._read = (struct.Struct(f"{len(v.nz)}d") for v in (entering, leaving))
        self._ends: list[int | None] = []
        at = 0
        for part in one.begin:
            at += len(part or ())
            self._ends.append(None if part is None else at)
        self._commanded = at + one.command.numel()

    def __call__(
        self, state: Any, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any, Info]:
        """Compute the command of one sample, its next state, and what is told about it."""
        entries = itertools.chain(*[part for part in state if part is not None])
        self._packed.pack_into(self._arguments, 0, *entries, *measurement, *reference)
        self._called.call()
        values = self._read.unpack_from(self._results)
        if not math.isfinite(sum(values)):
            return self._law.law(state, measurement, reference, FLOATS)
        parts, begin = [], 0
        for end in self._ends:
            parts.append(None if end is None else values[begin:end])
            begin = end or begin
        command = values[begin : self._commanded]
        told = dict(zip(self._names, values[self._commanded :], strict=True))
        return command, self._kind(*parts), told
