"""Hysteresis of muscles and at any effort: soft, curved loops with memory.

Spring-and-slip elements are elasto-plastic and slip after ``breakaway spread^(i-1)`` of motion. One
element is a spring behind a dry contact; eight equal ones with a spread of 1.6 cover break-aways
from one to 27 times the smallest, as the curved loops of muscles need. The loop of Bouc and
Wen is Dahl's law with the exponent 1; larger exponents turn more sharply.
"""

from __future__ import annotations

from collections.abc import Callable

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import EXACT, Expression, Form
from workbench.physics.law import (
    Law,
    Own,
    Rates,
    each,
    floor,
    rounding,
    shape,
    size,
    size_at,
    twins,
)
from workbench.physics.place import RESISTED

FLOOR_S = 1e-3
"""Time, in s, in which a contact that slips lets go of what it was stretched too far, so that
explicit integrators with steps of that length stay stable."""

_CORNER = 0.01
"""Stretch, over that at which a contact slips, within which its regularised form begins to."""


def stretched(z: Expression, form: Form = EXACT) -> Expression:
    """Return the force of a spring behind a dry contact over that at which it slips, dimensionless.

    It is clip(z, -1, 1).

    Args:
        z: Its stretch over that at which the contact slips, dimensionless; see `stretch_rate`.
    """
    return z - _beyond(z, form)


def stretch_rate(
    v: Expression,
    z: Expression,
    breakaway: Expression,
    *,
    time: Expression = FLOOR_S,
    form: Form = EXACT,
) -> Expression:
    """Return the rate, in 1/s, of the stretch of a spring behind a dry contact.

    ``dz/dt = v / breakaway - (z - clip(z, -1, 1)) / time``; for time to 0 it is the stop operator.
    A motion that turns slowly against ``time`` is remembered as by that, however fast it was.

    Args:
        v: Speed of the motion, in any unit per second.
        z: Stretch over that at which the contact slips, dimensionless.
        breakaway: Motion after which it slips, in the unit of the motion.
        time: Time in which the contact gives way, in s.

    Source:
        Krasnosel'skii and Pokrovskii 1989, stop operator; P. Perzyna 1966 for the time.
    """
    return v / breakaway - _beyond(z, form) / time


def _beyond(z: Expression, form: Form) -> Expression:
    return form.ramp(z - 1.0, _CORNER) - form.ramp(-z - 1.0, _CORNER)


_MUSCLE_WIDTH = 1e-5
"""Speed of a muscle, in m/s, within which the regularised form rounds the reversal."""

_SPREAD = 1.6
_ELEMENTS = 8


def _mean_slip(at: PortView, count: int) -> Expression:
    weights = [1.0, *(at.p[f"weight_{i + 1}"] for i in range(1, count))]
    slips = [stretched(at.x[f"slip_{i + 1}"], at.form) for i in range(count)]
    return sum(w * z for w, z in zip(weights, slips, strict=True)) / sum(weights)


def _slip_rates(
    count: int, speed: str, time: Callable[[EffectView], Expression] = lambda e: FLOOR_S
) -> Rates:
    """Return the rates of the elements, which let go in a time in s."""

    def rates(e: EffectView) -> dict[str, Expression]:
        return {
            f"slip_{i + 1}": stretch_rate(
                e.here.signals[speed],
                e.x[f"slip_{i + 1}"],
                e.p.breakaway * (e.p.spread**i if i else 1.0),
                time=time(e),
                form=e.form,
            )
            for i in range(count)
        }

    return rates


def _states(count: int) -> tuple[State, ...]:
    return tuple(
        State(f"slip_{i + 1}", "1", 1.0, f"stretch of element {i + 1}", start_rms=0.5)
        for i in range(count)
    )


def _elements(count: int) -> tuple[Own, ...]:
    ratio = shape("spread", "1", _SPREAD, "ratio of the break-aways of neighbouring elements",
                  between=(1.2, 6.0), scale=1.0)  # fmt: skip
    weights = (
        shape(f"weight_{i + 1}", "1", 1.0, f"force of element {i + 1} over that of element 1",
              between=(0.0, 20.0), refined=True)
        for i in range(1, count)
    )  # fmt: skip
    return (*((ratio,) if count > 1 else ()), *weights)


def muscle_slip(elements: int = _ELEMENTS) -> Law:
    """Return the Maxwell-slip law of muscles with a number of elements."""

    def transform(at: PortView) -> Expression:
        growth = 1.0 + at.p.growth * at.form.ramp(at.signals.gauge_pressure, 1e3)
        return at.value - at.p.level * growth * _mean_slip(at, elements)

    return Law(
        "maxwell_slip_hysteresis",
        "F = F0 - level (1 + growth p) sum(w_i z_i) / sum(w_i), z_i elasto-plastic",
        twins("muscle_force", needs=("contraction_speed", "gauge_pressure")),
        lambda at: (
            size("level", "N", 10.0, 100.0, "half width of the loop without pressure"),
            shape("growth", "Pa^-1", 7e-6, "relative growth of the half width with pressure",
                  between=(0.0, 2e-4), scale=1e-5),
            shape("breakaway", "m", 2.5e-4, "contraction after which the first element slips",
                  between=(5e-5, 5e-3)),
            *_elements(elements),
        ),
        transform,
        states=lambda at: _states(elements),
        rates=_slip_rates(elements, "contraction_speed"),
        dry=True,
        source="W. D. Iwan 1966; Vo-Minh, Tjahjowidodo, Ramon and Van Brussel, Mechatronics 20"
        " (2010)",
        look_alikes=("muscle_hysteresis", "pressure_friction", "coulomb_friction"),
        separated_by="isometric pressure cycles and nested reversals of several amplitudes",
    )  # fmt: skip


def prandtl_ishlinskii(elements: int = _ELEMENTS) -> Law:
    """Return a weighted sum of stop operators at any port that drives a speed."""
    return Law(
        "joint_hysteresis",
        "y = y - level sum(w_i z_i) / sum(w_i), z_i stop operators",
        each(*RESISTED, needs=("speed",)),
        lambda at: (
            size_at(at, "level", 0.05, 0.5, "half width of the loop", resists=True),
            shape("breakaway", at.coordinate.unit, 2e-3 * at.coordinate.scale,
                  "motion after which the first element slips", around=(0.05, 20.0)),
            *_elements(elements),
            floor(at, 0.5),
        ),
        lambda at: at.value - at.p.level * _mean_slip(at, elements),
        states=lambda at: _states(elements),
        rates=_slip_rates(elements, "speed", lambda e: e.p.floor),
        shapes=lambda at: [{"breakaway": k * at.coordinate.scale} for k in (2e-3, 1e-2)],
        dry=True,
        usual=True,
        source="L. Prandtl 1928, A. Yu. Ishlinskii 1944; Krasnosel'skii and Pokrovskii 1989",
        look_alikes=("lugre_friction", "coulomb_friction", "bouc_wen_hysteresis"),
        separated_by="nested reversals: the loops remember every turning point not yet passed",
    )  # fmt: skip


maxwell_slip_hysteresis = muscle_slip()
joint_hysteresis = prandtl_ishlinskii()


_TURN_WIDTH = 1e-3
"""Position in the loop within which its middle is rounded, dimensionless."""


def _turn(
    speed: str, regular: Callable[[EffectView], tuple[Expression, Expression, Expression]]
) -> Rates:
    """Return the rates of the loop, with beta, gamma and the speed that rounds the reversal."""

    def rates(e: EffectView) -> dict[str, Expression]:
        v, z, (beta, gamma, width) = e.here.signals[speed], e.x.turn, regular(e)
        # |z|^(n-1) is kept off zero, where its derivative would be infinite for n < 2.
        sharp = (z * z + 1e-12) ** (0.5 * (e.p.exponent - 1.0))
        turned = beta * e.form.absolute(v, width) * z
        turned += gamma * v * e.form.absolute(z, _TURN_WIDTH)
        return {"turn": (v - sharp * turned) / e.p.breakaway}

    return rates


def _loop(largest: float = 1.05) -> tuple[State, ...]:
    return (State("turn", "1", 1.0, "position in the loop", 0.0, -largest, largest, 0.5),)


def _of_muscle_loop(at: PortView) -> Expression:
    pressure = at.form.ramp(at.signals.gauge_pressure, 1e3)
    return at.value - (at.p.level + at.p.level_per_pressure * pressure) * at.x.turn


muscle_hysteresis = Law(
    "muscle_hysteresis",
    "F = F0 - (level + level_per_pressure p) z,"
    " dz/dt = (v - (1 - gamma) |v| |z|^(n-1) z - gamma v |z|^n) / breakaway",
    twins("muscle_force", needs=("contraction_speed", "gauge_pressure")),
    lambda at: (
        shape("level", "N", 10.0, "half width of the loop without pressure", between=(0.0, 100.0),
              source="", absent=0.0),
        size("level_per_pressure", "N/Pa", 7e-5, 5e-4,
             "growth of the half width with pressure", scale=1e-4),
        shape("breakaway", "m", 5e-4, "contraction over which the loop turns", between=(5e-5, 1e-2),
              source=""),
        shape("exponent", "1", 1.0, "sharpness of the turn", between=(1.0, 6.0), source="",
              refined=True),
        shape("gamma", "1", 0.0, "above 0 the ends of the loop soften, below they harden",
              between=(-1.0, 0.9), scale=1.0, source="", refined=True),
    ),
    _of_muscle_loop,
    states=lambda at: _loop(),
    rates=_turn("contraction_speed", lambda e: (1.0 - e.p.gamma, e.p.gamma, _MUSCLE_WIDTH)),
    shapes=lambda at: (
        {"breakaway": 5e-4}, {"breakaway": 2e-3}, {"breakaway": 5e-4, "exponent": 2.0},
    ),
    dry=True,
    usual=True,
    source="R. Bouc 1967, Y.-K. Wen 1976; P. R. Dahl 1968 for n = 1 without gamma",
    look_alikes=("coulomb_friction", "maxwell_slip_hysteresis"),
    separated_by="isometric pressure cycles: joint friction shows no loop there",
)  # fmt: skip

bouc_wen_hysteresis = Law(
    "bouc_wen_hysteresis",
    "T = T0 - level z, dz/dt = (v - |v| |z|^(n-1) z - skew v |z|^n) / breakaway",
    each(*RESISTED, needs=("speed",)),
    lambda at: (
        size_at(at, "level", 0.05, 0.5, "half width of the loop", resists=True),
        shape("breakaway", at.coordinate.unit, 1e-2 * at.coordinate.scale,
              "motion over which the loop turns", around=(0.02, 500.0)),
        shape("skew", "1", 0.0, "gamma over beta: above 0 the ends soften, below they harden",
              between=(-3.0, 3.0), scale=1.0),
        shape("exponent", "1", 1.0, "sharpness of the turn", between=(1.0, 6.0), refined=True),
        rounding(at),
    ),
    lambda at: at.value - at.p.level * at.x.turn,
    states=lambda at: _loop(20.0),
    rates=_turn("speed", lambda e: (1.0, e.p.skew, e.p.rounding_speed)),
    shapes=lambda at: [
        {"breakaway": k * at.coordinate.scale, "exponent": n, "skew": skew}
        for k, n, skew in ((1e-2, 1.0, 0.0), (1e-1, 1.0, 0.0), (1e-1, 2.0, 0.0), (1.0, 1.0, -1.0))
    ],
    dry=True,
    source="R. Bouc 1967, Y.-K. Wen 1976; P. R. Dahl 1968 for n = 1 without skew",
    look_alikes=("joint_hysteresis", "coulomb_friction", "lugre_friction"),
    separated_by="nested reversals of several amplitudes: this law does not close small loops",
)  # fmt: skip
