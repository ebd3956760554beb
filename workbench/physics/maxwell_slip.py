"""Hysteresis of several spring-and-slip elements: soft, curved loops with memory.

Each element is elasto-plastic and slips after ``breakaway spread^(i-1)`` of motion. One element is
a spring behind a dry contact; five equal ones with a spread of two cover break-aways from one to
sixteen times the smallest, as the curved loops of muscles need.
"""

from __future__ import annotations

from collections.abc import Callable

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.elastoplastic import FLOOR_S, elastoplastic_rate
from workbench.physics.law import Law, Own, Rates, each, floor, rounding, shape, size, twins
from workbench.physics.place import RESISTED, Place

_MUSCLE_WIDTH = 1e-5
"""Speed of a muscle, in m/s, within which the regularised form rounds the reversal."""

_SPREAD = 2.0
_ELEMENTS = 5


def _mean_slip(at: PortView, count: int) -> Expression:
    weights = [1.0, *(at.p[f"weight_{i + 1}"] for i in range(1, count))]
    slips = [at.x[f"slip_{i + 1}"] for i in range(count)]
    return sum(w * z for w, z in zip(weights, slips, strict=True)) / sum(weights)


def _slip_rates(
    count: int, speed: str, regular: Callable[[EffectView], tuple[Expression, Expression]]
) -> Rates:
    """Return the rates of the elements, with the speed and the time that keep them regular."""

    def rates(e: EffectView) -> dict[str, Expression]:
        width, time = regular(e)
        return {
            f"slip_{i + 1}": elastoplastic_rate(
                e.here.signals[speed],
                e.x[f"slip_{i + 1}"],
                e.p.breakaway * (e.p.spread**i if i else 1.0),
                width,
                floor=time,
                form=e.form,
            )
            for i in range(count)
        }

    return rates


def _states(count: int) -> tuple[State, ...]:
    return tuple(
        State(f"slip_{i + 1}", "1", 1.0, f"deflection of element {i + 1}", 0.0, -1.05, 1.05, 0.5)
        for i in range(count)
    )


def _elements(count: int) -> tuple[Own, ...]:
    ratio = shape("spread", "1", _SPREAD, "ratio of the break-aways of neighbouring elements",
                  around=None, between=(1.2, 6.0), scale=1.0)  # fmt: skip
    weights = (
        shape(f"weight_{i + 1}", "1", 1.0, f"force of element {i + 1} over that of element 1",
              around=None, between=(0.0, 20.0), fitted=False)
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
                  around=None, between=(0.0, 2e-4), scale=1e-5),
            shape("breakaway", "m", 2.5e-4, "contraction after which the first element slips",
                  around=None, between=(5e-5, 5e-3)),
            *_elements(elements),
        ),
        transform,
        states=lambda at: _states(elements),
        rates=_slip_rates(elements, "contraction_speed", lambda e: (_MUSCLE_WIDTH, FLOOR_S)),
        dry=True,
        source="W. D. Iwan 1966; Vo-Minh, Tjahjowidodo, Ramon and Van Brussel, Mechatronics 20"
        " (2010)",
        look_alikes=("muscle_hysteresis", "pressure_friction", "coulomb_friction"),
        separated_by="isometric pressure cycles and nested reversals of several amplitudes",
    )  # fmt: skip


def prandtl_ishlinskii(elements: int = _ELEMENTS) -> Law:
    """Return a weighted sum of stop operators at any port that drives a speed."""

    def breakaways(at: Place) -> list[dict[str, float]]:
        return [{"breakaway": k * at.coordinate.scale} for k in (2e-3, 1e-2)]

    return Law(
        "joint_hysteresis",
        "y = y - level sum(w_i z_i) / sum(w_i), z_i stop operators",
        each(*RESISTED, needs=("speed",)),
        lambda at: (
            size("level", at.unit, 0.05 * at.scale, 0.5 * at.scale,
                 "half width of the loop", resists=True),
            shape("breakaway", at.coordinate.unit, 2e-3 * at.coordinate.scale,
                  "motion after which the first element slips", around=(0.05, 20.0)),
            *_elements(elements),
            rounding(at),
            floor(at, 0.5),
        ),
        lambda at: at.value - at.p.level * _mean_slip(at, elements),
        states=lambda at: _states(elements),
        rates=_slip_rates(elements, "speed", lambda e: (e.p.rounding_speed, e.p.floor)),
        shapes=breakaways,
        dry=True,
        source="L. Prandtl 1928, A. Yu. Ishlinskii 1944; Krasnosel'skii and Pokrovskii 1989",
        look_alikes=("lugre_friction", "coulomb_friction", "bouc_wen_hysteresis"),
        separated_by="nested reversals: the loops remember every turning point not yet passed",
    )  # fmt: skip


maxwell_slip_hysteresis = muscle_slip()
joint_hysteresis = prandtl_ishlinskii()
