"""What a unit measures: the kind of a signal, its SI unit and the unit people read it in."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.model.units import in_si, parse_unit


@dataclass(frozen=True)
class Kind:
    """A physical quantity, its SI unit, and the unit in which people of the field read it."""

    name: str
    unit: str
    display_unit: str


_KINDS = (
    Kind("dimensionless", "1", "1"),
    Kind("time", "s", "s"),
    Kind("angle", "rad", "deg"),
    Kind("angular speed", "rad/s", "deg/s"),
    Kind("angular acceleration", "rad/s2", "deg/s2"),
    Kind("pressure", "Pa", "bar"),
    Kind("pressure rate", "Pa/s", "bar/s"),
    Kind("voltage", "V", "V"),
    Kind("current", "A", "A"),
    Kind("length", "m", "mm"),
    Kind("speed", "m/s", "m/s"),
    Kind("acceleration", "m/s2", "m/s2"),
    Kind("area", "m2", "mm2"),
    Kind("volume", "m3", "l"),
    Kind("volume flow", "m3/s", "l/min"),
    Kind("mass flow", "kg/s", "g/s"),
    Kind("mass", "kg", "kg"),
    Kind("force", "N", "N"),
    Kind("torque", "N m", "N m"),
    Kind("power", "W", "W"),
    Kind("heat flux", "W/m2", "W/m2"),
    Kind("temperature", "K", "degC"),
    Kind("concentration", "mol/m3", "mol/l"),
    Kind("frequency", "Hz", "Hz"),
)
UNSTATED = Kind("unstated", "", "")


def kind_of(unit: str) -> Kind:
    """Return what a unit measures, named after its SI unit if that has no common name.

    Args:
        unit: Any unit known to `workbench.model.units`; ``""`` for a signal without stated unit.

    Example:
        >>> kind_of("deg/s").name, kind_of("N/m").unit
        ('angular speed', 'kg/s2')
    """
    if not unit:
        return UNSTATED
    parsed = parse_unit(unit)
    for kind in _KINDS:
        if parse_unit(kind.unit).dimensions == parsed.dimensions:
            return kind
    text = in_si(unit)
    return Kind(text, text, text)
