"""Readings of a sensor whose steps are coarse beside its noise."""

from __future__ import annotations

import numpy as np

from workbench.arrays import Vector


def at_steps(measured: Vector, step: float) -> Vector:
    """Return what a coarse measurement tells: first, where it steps, and once between two steps.

    Samples that repeat a reading repeat its rounding error. Where it steps by one, the quantity was
    between the two readings, the nearer to their middle the longer the last one had stood.

    Args:
        measured: Samples in steps, shape (n,); NaN where there is none.
        step: The distance of readings, in the same unit.

    Returns:
        Samples, shape (n,); NaN where a sample tells nothing new.

    Example:
        >>> at_steps(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 3.0, 5.0]), 1.0)
        array([0. , nan, 0. , nan, nan, 0.6, 3. , 5. ])
    """
    known = np.flatnonzero(np.isfinite(measured))
    values, told = measured[known], np.full(len(measured), np.nan)
    change = np.diff(values)
    first = np.flatnonzero(np.concatenate([[True], change != 0.0]))[: len(values)]
    stood = np.diff(np.append(first, len(values)))
    middle = (first + (stood - 1) // 2)[stood > 2]
    told[known[:1]], told[known[middle]] = values[:1], values[middle]
    at, moved, before = first[1:], change[first[1:] - 1], stood[:-1]
    part = np.where(np.abs(moved) < 1.5 * step, 0.5 * (1.0 - 1.0 / before), 0.0)
    told[known[at]] = values[at] - part * moved
    return told
