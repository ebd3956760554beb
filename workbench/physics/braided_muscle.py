"""A braided muscle beside the ideal braid: flattened ends, the force of its wall, its tendon."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from workbench.model import PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.law import Fit, Law, Own, by_number, shape, size, size_at, twins
from workbench.physics.place import Place
from workbench.physics.survey import Survey

_NEEDS = ("contraction", "gauge_pressure")


def _further(at: PortView) -> Expression:
    # Wherever the equations of the force have the contraction: no geometry of its own is needed.
    q = at.signals.contraction
    return ca.substitute(ca.SX(at.value), ca.SX(q), (1.0 + at.p.excess) * q)


end_factor = Law(
    "end_factor",
    "F = F(k q, p), k = 1 + excess",
    twins("muscle_tension", "force", needs=_NEEDS, only=lambda at: at.shaped),
    lambda at: (size("excess", "1", 0.1, 2.0, "factor on the contraction less one", signed=True),),
    _further,
    source="B. Tondu and P. Lopez 2000, factor k of the flattened ends",
    look_alikes=("wall_term", "contraction_force_correction", "linear_spring"),
    separated_by="slope of the force over pressure, at several contractions",
)


def _wall(at: Place) -> tuple[Own, ...]:
    length = at.other("contraction")
    return (
        size_at(at, "force", 0.2, 5.0, "force of the wall at the plateau", signed=True),
        shape("reach", length.unit, 0.3 * length.scale, "contraction that leads to the plateau",
              around=(0.05, 20.0)),
        shape("start", "1", 0.0, "force at full length over that of the plateau",
              between=(-5.0, 5.0), scale=0.2),
    )  # fmt: skip


wall_term = Law(
    "wall_term",
    "F = F - force [start + tanh(q / reach)]",
    twins("muscle_tension", "force", needs=_NEEDS, only=lambda at: at.shaped),
    _wall,
    lambda at: at.value - at.p.force * (at.p.start + ca.tanh(at.signals.contraction / at.p.reach)),
    source="elastic wall, C.-P. Chou and B. Hannaford, IEEE Trans. Robotics Autom. 12 (1996)",
    look_alikes=("end_factor", "phi_term", "linear_spring", "constant_force"),
    separated_by="isometric pressure ramps at several contractions: the force without pressure",
)


_LAG = 0.002
"""Time, in s, in which the stretch follows the force, which avoids an algebraic loop: shorter than
any motion of the rig."""


def _beside_its_gas(survey: Survey) -> Iterator[Fit]:
    pulls = ("tension", "contraction_speed")
    lengths, gases, forces = (
        {number if (number := by_number(q)).isdigit() else "": q for q in found}
        for found in (
            survey.fitting("muscle_length"),
            survey.fitting("volume_rate", needs=("volume", *pulls)),
            survey.fitting("muscle_force", needs=pulls),
        )
    )
    together = lengths.keys() & gases.keys() & forces.keys()
    if sites := tuple((q, gases[n], forces[n]) for n, q in lengths.items() if n in together):
        yield "", sites


def _yields(at: PortView) -> Expression:
    """Rate of the force in the tendon, N/s, where the tension of its muscle is known."""
    p, s = at.p, at.signals
    damped = s.tension - p.viscosity * s.contraction_speed
    return (damped - at.x.pull) / ca.fmax(p.viscosity * p.compliance, _LAG)


def _stretched(at: PortView) -> Expression:
    p, pull = at.p, at.x.pull
    if at.index == 0:
        return at.value - p.compliance * pull
    if at.index == 1:
        # The gas gives way to what the force makes of the length.
        volume = ca.SX(at.signals.volume)
        return at.value + ca.jtimes(volume, ca.SX(pull), ca.SX(_yields(at)))
    # A muscle is damped by the rate of its own length.
    rate = at.signals.contraction_speed + p.compliance * _yields(at)
    return at.value - p.viscosity * rate


# The muscle is shorter than its anchors are apart by what tendons, fittings and clamps stretch:
# at 500 N and 7e-6 m/N by 3.5 mm, a twentieth of its gas volume.
series_elasticity = Law(
    "series_elasticity",
    "s = L - compliance F, F = F(s) + viscosity ds/dt",
    _beside_its_gas,
    lambda at: (
        size("compliance", "m/N", 7e-6, 2e-5, "stretch of the tendon over its force",
             source="1e5 to 2e5 N/m in the literature"),
        shape("viscosity", "N s/m", 0.0, "damping of the muscle in series with it",
              between=(0.0, 5000.0), scale=100.0, source="", refined=True),
    ),
    _stretched,
    states=lambda at: (State("pull", "N", 100.0, "force in the tendon", 300.0),),
    rates=lambda e: {"pull": _yields(list(e.at.values())[1])},
    start=lambda e: {"pull": list(e.at.values())[1].signals.tension},
    far=True,
    usual=True,
    source="A. V. Hill 1938, series element; compliance of fittings",
    look_alikes=("force_shape", "contraction_force_correction", "linear_spring"),
    separated_by="pressure steps with the joint locked at several angles",
)  # fmt: skip
