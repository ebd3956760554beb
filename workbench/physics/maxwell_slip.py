"""Hysteresis of many elements: Maxwell slip for muscles, Prandtl-Ishlinskii for any port."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression
from workbench.physics.elastoplastic import elastoplastic_rate
from workbench.physics.port_units import coordinate_of

_SPEED_WIDTH = 1e-5
"""Speed, in SI, within which the smooth face rounds the reversal."""

SPREAD = 2.0
"""Usual ratio of the break-aways of neighbouring elements."""

EVEN = (1.0, 1.0, 1.0, 1.0, 1.0)
"""Five equal elements: with a spread of two they cover break-aways from one to sixteen times the
smallest, as the curved loops of muscles need."""


def _state(port: int, element: int) -> str:
    return f"slip_{port + 1}_{element + 1}"


def _elements(
    name: str,
    ports: tuple[str, ...],
    size: Parameter,
    shape: tuple[Parameter, ...],
    *,
    growth: bool,
    breakaway: Parameter,
    spread: float,
    weights: tuple[float, ...],
    speed_signal: str,
    about: About,
) -> Effect:
    count = len(weights)

    def transform(at: PortView) -> Expression:
        shares = [1.0, *(at.p[f"weight_{i + 1}"] for i in range(1, count))]
        slips = [at.x[_state(at.index, i)] for i in range(count)]
        mean = sum(w * z for w, z in zip(shares, slips, strict=True)) / sum(shares)
        half_width = at.p.level
        if growth:
            half_width = half_width * (
                1.0 + at.p.growth * at.face.ramp(at.signals.gauge_pressure, 1e3)
            )
        return at.value - half_width * mean

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        return {
            _state(at.index, i): elastoplastic_rate(
                at.signals[speed_signal],
                effect.x[_state(at.index, i)],
                effect.p.breakaway * (effect.p.spread**i if i else 1.0),
                _SPEED_WIDTH,
                face=effect.face,
            )
            for at in effect.at.values()
            for i in range(count)
        }

    relative = tuple(
        Parameter(
            f"weight_{i + 1}",
            "1",
            1.0,
            f"force of element {i + 1} over that of element 1",
            weights[i] / weights[0],
            0.0,
            20.0,
            "estimate",
        )
        for i in range(1, count)
    )
    ratio = Parameter(
        "spread",
        "1",
        1.0,
        "ratio of the break-aways of neighbouring elements",
        spread,
        1.2,
        6.0,
        "estimate",
        fitted=True,
    )
    return Effect(
        name,
        ports,
        transform,
        parameters=(size, *shape, breakaway, *((ratio,) if count > 1 else ()), *relative),
        states=tuple(
            State(
                _state(port, i), "1", 1.0, f"deflection of element {i + 1}", 0.0, -1.05, 1.05, 0.5
            )
            for port in range(len(ports))
            for i in range(count)
        ),
        rates=rates,
        about=about,
    )


def maxwell_slip_hysteresis(
    ports: tuple[str, ...] = ("muscle_1.force", "muscle_2.force"),
    *,
    level: float = 10.0,
    growth: float = 7e-6,
    breakaway: float = 2.5e-4,
    spread: float = SPREAD,
    weights: tuple[float, ...] = EVEN,
    name: str = "maxwell_slip_hysteresis",
) -> Effect:
    """Build hysteresis of muscles by spring-and-slip elements in parallel.

    ``F = F_0 - level (1 + growth p) sum(w_i z_i) / sum(w_i)``, each z_i an elasto-plastic element
    that slips after ``breakaway spread^(i-1)`` of contraction. One element is a Dahl-like loop;
    more of them give the soft, curved loops and the memory of several reversals that muscles show.

    Args:
        ports: Ports of muscle forces, with the local signals ``contraction_speed`` and
            ``gauge_pressure``.
        level: Half width of the loop without pressure, in N.
        growth: Relative growth of the half width with gauge pressure, in 1/Pa.
        breakaway: Contraction after which the first element slips, in m.
        spread: Ratio of the break-aways of neighbouring elements, dimensionless.
        weights: Forces of the elements, relative to each other, dimensionless.
        name: Name of the effect.

    Returns:
        Effect of size ``level`` with one state per port and element.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> [state.name for state in maxwell_slip_hysteresis(weights=(1.0, 1.0)).states]
        ['slip_1_1', 'slip_1_2', 'slip_2_1', 'slip_2_2']
    """
    return _elements(
        name,
        ports,
        Parameter(
            "level",
            "N",
            10.0,
            "half width of the loop without pressure",
            level,
            0.0,
            100.0,
            fitted=True,
        ),
        (
            Parameter(
                "growth",
                "Pa^-1",
                1e-5,
                "relative growth of the half width with pressure",
                growth,
                0.0,
                2e-4,
                "estimate",
                fitted=True,
            ),
        ),
        growth=True,
        breakaway=Parameter(
            "breakaway",
            "m",
            2.5e-4,
            "contraction after which the first element slips",
            breakaway,
            5e-5,
            5e-3,
            "estimate",
            fitted=True,
        ),
        spread=spread,
        weights=weights,
        speed_signal="contraction_speed",
        about=About(
            "F = F0 - level (1 + growth p) sum(w_i z_i) / sum(w_i), z_i elasto-plastic",
            "W. D. Iwan 1966; Vo-Minh, Tjahjowidodo, Ramon and Van Brussel, Mechatronics 20 (2010)",
            look_alikes=("muscle_hysteresis", "pressure_friction", "coulomb_friction"),
            separated_by="isometric pressure cycles and nested reversals of several amplitudes",
        ),
    )


def prandtl_ishlinskii(
    port: str = "joint.torque",
    *,
    level: float = 0.5,
    breakaway: float = 2e-3,
    spread: float = SPREAD,
    weights: tuple[float, ...] = EVEN,
    speed_signal: str = "speed",
    unit: str = "N m",
    speed_unit: str = "rad/s",
    upper: float = 10.0,
    typical: float = 0.5,
    name: str = "prandtl_ishlinskii",
) -> Effect:
    """Build rate-independent hysteresis at any port with a local speed.

    ``y = y - level sum(w_i z_i) / sum(w_i)``, a weighted sum of stop operators, each of which slips
    after ``breakaway spread^(i-1)`` of motion.

    Args:
        port: Port with the local signal ``speed_signal``.
        level: Half width of the loop, in ``unit``.
        breakaway: Motion after which the first element slips, in the unit of the coordinate.
        spread: Ratio of the break-aways of neighbouring elements, dimensionless.
        weights: Shares of the elements, relative to each other, dimensionless.
        speed_signal: Name of the local signal that is the speed of the motion.
        unit: Unit of the port.
        speed_unit: Unit of the speed.
        upper: Largest plausible level, in ``unit``.
        typical: Usual level, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``level`` with one state per element.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> len(prandtl_ishlinskii().states)
        5
    """
    return _elements(
        name,
        (port,),
        Parameter("level", unit, typical, "half width of the loop", level, 0.0, upper, fitted=True),
        (),
        growth=False,
        breakaway=Parameter(
            "breakaway",
            coordinate_of(speed_unit),
            breakaway,
            "motion after which the first element slips",
            breakaway,
            0.05 * breakaway,
            20.0 * breakaway,
            "estimate",
            fitted=True,
        ),
        spread=spread,
        weights=weights,
        speed_signal=speed_signal,
        about=About(
            "y = y - level sum(w_i z_i) / sum(w_i), z_i stop operators",
            "L. Prandtl 1928, A. Yu. Ishlinskii 1944; Krasnosel'skii and Pokrovskii 1989",
            look_alikes=("lugre_friction", "coulomb_friction"),
            separated_by="nested reversals: the loops remember every turning point not yet passed",
        ),
    )
