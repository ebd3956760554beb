"""Units that follow from the unit of a port: stiffness, damping, inverse powers."""

from __future__ import annotations


def per(unit: str, divisor: str, power: int = 1) -> str:
    """Return the unit of a quantity per power of another one.

    Args:
        unit: Unit of the numerator, such as ``"N m"``.
        divisor: Unit of one factor of the denominator, such as ``"rad"``.
        power: Exponent of the divisor.

    Example:
        >>> per("N m", "rad"), per("N", "m", 3)
        ('N m/rad', 'N/m3')
    """
    if divisor in ("", "1"):
        return unit
    return f"{unit}/{divisor}{power if power > 1 else ''}"


def coordinate_of(speed_unit: str) -> str:
    """Return the unit of the coordinate whose speed is given.

    Args:
        speed_unit: Unit of a speed, such as ``"rad/s"``.

    Example:
        >>> coordinate_of("rad/s")
        'rad'
    """
    return speed_unit.removesuffix("/s")


def damping_unit(unit: str, speed_unit: str, power: int = 1) -> str:
    """Return the unit of a force or torque per power of a speed.

    Args:
        unit: Unit of the force or torque, such as ``"N m"``.
        speed_unit: Unit of the speed, such as ``"rad/s"``.
        power: Exponent of the speed.

    Example:
        >>> damping_unit("N m", "rad/s"), damping_unit("N", "m/s", 2)
        ('N m s/rad', 'N s2/m2')
    """
    exponent = str(power) if power > 1 else ""
    return f"{unit} s{exponent}/{coordinate_of(speed_unit)}{exponent}"
