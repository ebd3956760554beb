"""The elasto-plastic element: follows a motion until it slips."""

from __future__ import annotations

from workbench.model.regularisation import EXACT, Expression, Form, minimum

SHARPNESS = 6
"""Exponent of the turn into slip: the larger, the closer to a spring behind a dry contact."""

FLOOR_S = 1e-3
"""Time, in s, than which no element is faster at high speed, so that explicit integrators with
steps of that length stay stable. The break-away is stretched by ``SHARPNESS speed floor``, which
matters only where the element slips anyway."""

_FARTHEST = 1.1


def elastoplastic_rate(
    v: Expression,
    z: Expression,
    breakaway: Expression,
    width: float,
    *,
    floor: Expression = FLOOR_S,
    form: Form = EXACT,
) -> Expression:
    """Return the rate, in 1/s, of an elasto-plastic deflection relative to its break-away.

    ``dz/dt = v (1 - max(0, z sign v)^n) / breakaway``: elastic with slope 1 / breakaway when
    unloading, saturating at 1 when loading. For n to infinity it is the stop operator, a spring in
    series with a dry contact. It is rate independent up to 1 / floor.

    Args:
        v: Speed of the motion, in any unit per second.
        z: Deflection over break-away, -1..1, dimensionless.
        breakaway: Motion after which the element slips, in the unit of the motion.
        width: Speed within which the regularised form rounds the reversal, in the unit of ``v``.
        floor: Time than which the element is not faster, in s.

    Source:
        P. A. Bliman and M. Sorine 1995; Dupont et al., IEEE TAC 47 (2002).
    """
    forward, backward = form.ramp(v, width), form.ramp(-v, width)
    # The ramps of z need no rounding: their sixth power is smooth at zero.
    # A filter may correct z beyond 1; from there it comes back at a limited rate.
    loaded = minimum(EXACT.ramp(z, 1.0), _FARTHEST) ** SHARPNESS
    pulled = minimum(EXACT.ramp(-z, 1.0), _FARTHEST) ** SHARPNESS
    reach = breakaway + (forward + backward) * (SHARPNESS * floor)
    return (v - forward * loaded + backward * pulled) / reach
