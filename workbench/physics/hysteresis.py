"""Rate-independent hysteresis after Bouc and Wen, of a muscle and at any effort.

The exponent 1 is Dahl's law; larger exponents turn more sharply.
"""

from __future__ import annotations

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, Rates, each, rounding, shape, size, twins
from workbench.physics.place import RESISTED

_MUSCLE_WIDTH = 1e-5
"""Speed of a muscle, in m/s, within which the regularised form rounds the reversal."""

_TURN_WIDTH = 1e-3
"""Position in the loop within which its middle is rounded, dimensionless."""


def _turn(speed: str, *, skewed: bool = False) -> Rates:
    """Return the rates of the loop; skewed, it rounds within a speed of the law's own."""

    def rates(e: EffectView) -> dict[str, Expression]:
        v, z = e.here.signals[speed], e.x.turn
        # |z|^(n-1) is kept off zero, where its derivative would be infinite for n < 2.
        sharp = (z * z + 1e-12) ** (0.5 * (e.p.exponent - 1.0))
        turned = e.form.absolute(v, e.p.rounding_speed if skewed else _MUSCLE_WIDTH) * z
        if skewed:
            turned += e.p.skew * v * e.form.absolute(z, _TURN_WIDTH)
        return {"turn": (v - sharp * turned) / e.p.breakaway}

    return rates


def _state(largest: float = 1.05) -> tuple[State, ...]:
    return (State("turn", "1", 1.0, "position in the loop", 0.0, -largest, largest, 0.5),)


def _of_muscle(at: PortView) -> Expression:
    pressure = at.form.ramp(at.signals.gauge_pressure, 1e3)
    return at.value - (at.p.level + at.p.level_per_pressure * pressure) * at.x.turn


muscle_hysteresis = Law(
    "muscle_hysteresis",
    "F = F0 - (level + level_per_pressure p) z, dz/dt = (v - |v| |z|^(n-1) z) / breakaway",
    twins("muscle_force", needs=("contraction_speed", "gauge_pressure")),
    lambda at: (
        shape("level", "N", 10.0, "half width of the loop without pressure",
              around=None, between=(0.0, 100.0), source="", absent=0.0),
        size("level_per_pressure", "N/Pa", 7e-5, 5e-4,
             "growth of the half width with pressure", scale=1e-4),
        shape("breakaway", "m", 5e-4, "contraction over which the loop turns",
              around=None, between=(5e-5, 1e-2), source=""),
        shape("exponent", "1", 1.0, "sharpness of the turn",
              around=None, between=(1.0, 6.0), source="", fitted=False),
    ),
    _of_muscle,
    states=lambda at: _state(),
    rates=_turn("contraction_speed"),
    shapes=lambda at: (
        {"breakaway": 5e-4}, {"breakaway": 2e-3}, {"breakaway": 5e-4, "exponent": 2.0},
    ),
    dry=True,
    source="R. Bouc 1967, Y.-K. Wen 1976; P. R. Dahl 1968 for n = 1",
    look_alikes=("coulomb_friction", "maxwell_slip_hysteresis"),
    separated_by="isometric pressure cycles: joint friction shows no loop there",
)  # fmt: skip

bouc_wen_hysteresis = Law(
    "bouc_wen_hysteresis",
    "T = T0 - level z, dz/dt = (v - |v| |z|^(n-1) z - skew v |z|^n) / breakaway",
    each(*RESISTED, needs=("speed",)),
    lambda at: (
        size("level", at.unit, 0.05 * at.scale, 0.5 * at.scale,
             "half width of the loop", resists=True),
        shape("breakaway", at.coordinate.unit, 1e-2 * at.coordinate.scale,
              "motion over which the loop turns", around=(0.02, 500.0)),
        shape("skew", "1", 0.0, "gamma over beta: above 0 the ends soften, below they harden",
              around=None, between=(-3.0, 3.0), scale=1.0),
        shape("exponent", "1", 1.0, "sharpness of the turn",
              around=None, between=(1.0, 6.0), fitted=False),
        rounding(at),
    ),
    lambda at: at.value - at.p.level * at.x.turn,
    states=lambda at: _state(20.0),
    rates=_turn("speed", skewed=True),
    shapes=lambda at: [
        {"breakaway": k * at.coordinate.scale, "exponent": n, "skew": skew}
        for k, n, skew in ((1e-2, 1.0, 0.0), (1e-1, 1.0, 0.0), (1e-1, 2.0, 0.0), (1.0, 1.0, -1.0))
    ],
    dry=True,
    source="R. Bouc 1967, Y.-K. Wen 1976; P. R. Dahl 1968 for n = 1 without skew",
    look_alikes=("joint_hysteresis", "coulomb_friction", "lugre_friction"),
    separated_by="nested reversals of several amplitudes: this law does not close small loops",
)  # fmt: skip
