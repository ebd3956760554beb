"""Dry friction whose level follows a load: bearing forces or a pressure."""

from __future__ import annotations

import casadi as ca

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.port_units import per


def load_dependent_friction(
    ports: tuple[str, ...] = ("joint.torque",),
    *,
    coefficient: float = 5e-4,
    loads: tuple[str, ...] = ("force_1", "force_2"),
    speed_signal: str = "speed",
    transition_speed: float = 0.02,
    unit: str = "N m",
    load_unit: str = "N",
    speed_unit: str = "rad/s",
    upper: float = 1e-2,
    typical: float = 5e-4,
    name: str = "load_dependent_friction",
) -> Effect:
    """Build dry friction proportional to the sum of local signals.

    ``T = T - coefficient (sum of loads) tanh(v / transition_speed)``. For a bearing the coefficient
    is friction coefficient times journal radius; with ``loads=("gauge_pressure",)`` on a muscle's
    force it is the friction between braid and tube.

    Args:
        ports: Ports of forces or torques, with the speed and the loads as local signals.
        coefficient: Friction over load, in ``unit`` per ``load_unit``.
        loads: Names of the local signals that load the contact; negative sums count as none.
        speed_signal: Name of the local signal that is the speed of sliding.
        transition_speed: Speed at which tanh reaches 76 %, in ``speed_unit``.
        unit: Unit of the ports: ``"N m"`` or ``"N"``.
        load_unit: Unit of the loads.
        speed_unit: Unit of the speed: ``"rad/s"`` or ``"m/s"``.
        upper: Largest plausible coefficient, in ``unit`` per ``load_unit``.
        typical: Usual coefficient, in ``unit`` per ``load_unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``coefficient``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> load_dependent_friction().parameters[0].unit
        'N m/N'
    """

    def transform(at: PortView) -> Expression:
        load = at.face.ramp(sum(at.signals[signal] for signal in loads), 1.0)
        sliding = ca.tanh(at.signals[speed_signal] / at.p.transition_speed)
        return at.value - at.p.coefficient * load * sliding

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "coefficient",
                per(unit, load_unit),
                typical,
                "friction over load",
                coefficient,
                0.0,
                upper,
                fitted=True,
            ),
            Parameter(
                "transition_speed",
                speed_unit,
                transition_speed,
                "speed scale of the reversal",
                transition_speed,
                1e-3 * transition_speed,
                1e3 * transition_speed,
            ),
        ),
        about=About(
            "T = -coefficient (sum of loads) tanh(v / transition_speed)",
            "G. Amontons 1699; journal bearing under radial load",
            look_alikes=("coulomb_friction", "stribeck_friction", "muscle_hysteresis"),
            separated_by="the same motion at a low and at a high mean pressure",
        ),
    )
