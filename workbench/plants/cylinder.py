"""A pneumatic cylinder whose piston is moved from outside: seal friction against pressure.

E. Zillen, 3D-printed pneumatic actuator, MSc thesis, TU Delft 2021: cylinders of 25 mm, stroked
slowly by a test bench while a regulator holds the pressure.
"""

from __future__ import annotations

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations
from workbench.physics.friction import coulomb_friction, load_dependent_friction, viscous_friction
from workbench.plants.plant import Plant


def _equations(m: Scope) -> Equations:
    pushed = m.port(
        "piston.force",
        m.u.pressure * m.p.area + m.p.offset,
        unit="N",
        scale=100.0,
        description="force of the piston on the load cell, positive outwards",
        signals={"position": m.x.position, "speed": m.u.speed, "pressure": m.u.pressure},
        disturbance=2.0,
    )
    return (
        {"position": m.u.speed, "rod_force": (pushed - m.x.rod_force) / m.p.lag},
        {"force": m.port("force.reading", m.x.rod_force, unit="N")},
    )


def cylinder() -> Model:
    """Build the cylinder: piston area, friction of the seals that grows with pressure, a lag.

    ``F = p area + offset - (dry + per_pressure p) sign(v) - viscous v``, read with a first-order
    lag of the load cell; v is positive outwards.

    Returns:
        Model with the inputs ``speed`` (m/s, outwards) and ``pressure`` (Pa, gauge), the output
        ``force`` (N) and the port ``piston.force``.
    """
    return Model(
        "pneumatic cylinder",
        _equations,
        states=(
            State("position", "m", 0.04, "piston position, positive outwards"),
            State(
                "rod_force", "N", 100.0, "force that the load cell has taken up", start_rms=400.0
            ),
        ),
        inputs=(
            Input("speed", "m/s", 0.01, "speed of the piston, positive outwards"),
            Input("pressure", "Pa", 5e5, "gauge pressure of the chamber", lower=-1e5, upper=1.2e6),
        ),
        outputs=(Output("force", "N", 100.0, noise_rms=0.03),),
        parameters=(
            Parameter("area", "m2", 0.0, "area of the piston", 4.909e-4, 4.4e-4, 5.6e-4,
                      "diameter 25 mm", fitted=True),
            Parameter("offset", "N", 5.0, "zero of the load cell and weight of the rod",
                      0.0, -30.0, 30.0, fitted=True),
            Parameter("lag", "s", 0.0, "lag of the load cell and its converter", 0.02, 0.002, 0.2),
        ),
        description="a piston stroked from outside at constant pressure",
    ).with_effect(
        coulomb_friction("piston.force", level=3.0, transition_speed=1e-3, upper=40.0),
        load_dependent_friction("piston.force", coefficient=1e-5, transition_speed=1e-3,
                                upper=1e-4, typical=1e-5, name="seal_friction"),
        viscous_friction("piston.force", coefficient=100.0, upper=2000.0),
    )  # fmt: skip


CYLINDER = Plant("cylinder", cylinder, "pneumatic cylinder on a test bench, friction of its seals")
