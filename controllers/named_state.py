"""States of controllers by name: nested tuples with named fields, flat where numbers are needed.

A law reads and writes its state by name. The same state holds floats or CasADi symbols; its entries
one after the other are the array that an exported controller carries.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from controllers.arithmetic import Number

State = TypeVar("State")


def flat(state: Any) -> tuple[Number, ...]:
    """Return the entries of a state, one after the other."""
    return tuple(entry for _, entry in _entries("", state))


def names(state: Any) -> tuple[str, ...]:
    """Return the names of the entries; those of nested states are joined by a point."""
    return tuple(name for name, _ in _entries("", state))


def restored(example: State, entries: Sequence[Number]) -> State:
    """Return a state of the form of another from its entries."""
    taken = iter(entries)
    found: State = _taken(example, taken)
    return found


def _entries(name: str, part: Any) -> Iterator[tuple[str, Number]]:
    if part is None:
        return
    if isinstance(part, tuple):
        fields = getattr(part, "_fields", range(len(part)))
        for field, value in zip(fields, part, strict=True):
            yield from _entries(f"{name}.{field}" if name else str(field), value)
    elif isinstance(part, np.ndarray):
        yield from ((f"{name}.{i}", value) for i, value in enumerate(part.ravel().tolist()))
    else:
        yield name, part


def _taken(example: Any, entries: Iterator[Number]) -> Any:
    if example is None:
        return None
    if isinstance(example, tuple):
        parts = [_taken(value, entries) for value in example]
        return type(example)(*parts) if hasattr(example, "_fields") else tuple(parts)
    if isinstance(example, np.ndarray):
        values = [next(entries) for _ in range(example.size)]
        if any(isinstance(value, ca.SX) for value in values):
            return ca.vcat(values)
        return np.array(values, dtype=float).reshape(example.shape)
    return next(entries)
