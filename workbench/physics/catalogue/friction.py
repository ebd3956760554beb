"""Entries of friction for forces and torques that move something."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.physics.catalogue.moved import Motion
from workbench.physics.drag import direction_dependent_viscous, quadratic_drag
from workbench.physics.friction import coulomb_friction, viscous_friction
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.load_friction import load_dependent_friction
from workbench.physics.lugre import lugre_friction
from workbench.physics.maxwell_slip import prandtl_ishlinskii
from workbench.physics.stribeck import stribeck_friction


def entries(m: Motion) -> Iterator[Hypothesis]:
    """Yield the laws of friction that may act on one motion.

    Args:
        m: The motion.

    Example:
        >>> from workbench.physics.catalogue.moved import motions
        >>> from workbench.plants.arm import arm
        >>> [entry.name for entry in entries(motions(arm())[0])][:2]
        ['coulomb_friction', 'viscous_friction']
    """
    name, unit, v = m.port.name, m.port.unit, m.speed
    level, most = 0.05 * m.port.scale, 0.5 * m.port.scale
    least = 0.005 * m.port.scale
    yield Hypothesis(
        coulomb_friction(
            name,
            level=0.0,
            transition_speed=0.02 * v,
            unit=unit,
            speed_unit=m.speed_unit,
            upper=most,
            name=f"coulomb_friction{m.suffix}",
        ),
        "level",
        level,
        least,
        law="coulomb_friction",
    )
    yield Hypothesis(
        viscous_friction(
            name,
            coefficient=0.0,
            unit=unit,
            speed_unit=m.speed_unit,
            upper=most / v,
            name=f"viscous_friction{m.suffix}",
        ),
        "coefficient",
        level / v,
        least / v,
        law="viscous_friction",
    )
    yield Hypothesis(
        stribeck_friction(
            name,
            break_away=0.0,
            stribeck_speed=0.1 * v,
            transition_speed=0.02 * v,
            unit=unit,
            speed_unit=m.speed_unit,
            upper=most,
            typical=2 * level,
            name=f"stribeck_friction{m.suffix}",
        ),
        "break_away",
        2 * level,
        2 * least,
        law="stribeck_friction",
        shapes=tuple({"stribeck_speed": k * v} for k in (0.1, 0.03, 0.3)),
    )
    yield Hypothesis(
        lugre_friction(
            name,
            level=0.0,
            presliding=2e-3 * m.position,
            stribeck_speed=0.1 * v,
            unit=unit,
            speed_unit=m.speed_unit,
            upper=most,
            typical=level,
            name=f"lugre_friction{m.suffix}",
        ),
        "level",
        level,
        least,
        law="lugre_friction",
        shapes=tuple({"presliding": k * m.position} for k in (2e-3, 5e-4, 1e-2)),
    )
    yield Hypothesis(
        prandtl_ishlinskii(
            name,
            level=0.0,
            breakaway=2e-3 * m.position,
            unit=unit,
            speed_unit=m.speed_unit,
            upper=most,
            typical=level,
            name=f"joint_hysteresis{m.suffix}",
        ),
        "level",
        level,
        least,
        law="joint_hysteresis",
        shapes=tuple({"breakaway": k * m.position} for k in (2e-3, 1e-2)),
    )
    yield Hypothesis(
        quadratic_drag(
            name,
            coefficient=0.0,
            unit=unit,
            speed_unit=m.speed_unit,
            upper=most / v**2,
            typical=0.02 * m.port.scale / v**2,
            name=f"quadratic_drag{m.suffix}",
        ),
        "coefficient",
        0.02 * m.port.scale / v**2,
        least / v**2,
        law="quadratic_drag",
    )
    yield Hypothesis(
        direction_dependent_viscous(
            name,
            difference=0.0,
            unit=unit,
            speed_unit=m.speed_unit,
            upper=most / v,
            typical=0.5 * level / v,
            name=f"direction_dependent_viscous{m.suffix}",
        ),
        "difference",
        0.5 * level / v,
        least / v,
        law="direction_dependent_viscous",
    )
    scale = m.port.scale
    for loads, load_unit, size in (
        (("force_1", "force_2"), "N", 5e-5 * scale),
        (("gear_load",), "N m", 0.05),
        (("pressure",), "Pa", 1e-7 * scale),
        (("gauge_pressure",), "Pa", 1e-7 * scale),
    ):
        if set(loads) <= set(m.port.signals):
            yield Hypothesis(
                load_dependent_friction(
                    (name,),
                    coefficient=0.0,
                    loads=loads,
                    transition_speed=0.02 * v,
                    unit=unit,
                    load_unit=load_unit,
                    speed_unit=m.speed_unit,
                    upper=20 * size,
                    typical=size,
                    name=f"load_dependent_friction{m.suffix}",
                ),
                "coefficient",
                size,
                0.1 * size,
                law="load_dependent_friction",
            )
            break
