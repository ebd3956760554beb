"""The library of effects: everything that could be missing from a model, by its ports."""

from __future__ import annotations

from workbench.model import Effect, Model
from workbench.physics.catalogue import air, general, motion, muscles, sensors, valve
from workbench.physics.hypothesis import Hypothesis, look_alikes

__all__ = ["Hypothesis", "library", "look_alikes"]


def library(model: Model, *, outputs: tuple[str, ...] | None = None) -> tuple[Hypothesis, ...]:
    """Return every effect of the library that can act on the ports of a model, at zero size.

    A law that is attached to one of the ports already is left out: its size is a parameter of the
    model.

    Args:
        model: The model that may lack physics.
        outputs: Names of the outputs that are recorded, for the effects of sensors; all by default.

    Returns:
        Entries with different names, process before sensors.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> names = [entry.name for entry in library(servo_axis())]
        >>> "stribeck_friction" in names, "coulomb_friction" in names
        (True, False)
    """
    candidates = (
        *motion.entries(model),
        *muscles.entries(model),
        *valve.entries(model),
        *air.entries(model),
        *general.entries(model),
        *sensors.entries(model, outputs),
    )
    taken = {effect.name for effect in model.effects}
    return tuple(
        entry
        for entry in candidates
        if entry.name not in taken and not any(_same(entry, e) for e in model.effects)
    )


def _same(entry: Hypothesis, attached: Effect) -> bool:
    if entry.effect.about.equation == attached.about.equation:
        return bool(set(entry.ports) & set(attached.ports))
    places = [{port.split(".")[0] for port in ports} for ports in (entry.ports, attached.ports)]
    return entry.law == attached.name and bool(places[0] & places[1])
