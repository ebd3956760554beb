"""Sliders for the few numbers that matter, where the notebook can show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any


def sliders(function: Callable[..., Any], ranges: Mapping[str, tuple[float, float, float]]) -> Any:
    """Show a slider for each argument of a function beside what it returns.

    Args:
        ranges: Smallest value, largest value and step of each keyword, in its own unit, by name.

    Returns:
        What the function returns in the middle of the ranges where the package ipywidgets is not
        installed; None where sliders are shown.
    """
    if find_spec("ipywidgets") is not None:
        import_module("ipywidgets").interact(function, **ranges, continuous_update=False)
        return None
    middle = {
        n: low + step * round((high - low) / 2 / step) for n, (low, high, step) in ranges.items()
    }
    return function(**middle)
