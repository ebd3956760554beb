"""A load that is heavier or lighter than the notes say."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Fit, Law, shape, size
from workbench.physics.place import Survey
from workbench.physics.tilt import GRAVITY, LOAD_CENTRE

_OWN_INERTIA = 0.0015
"""Inertia of the load about its own centre over its mass, m^2."""


def _where(survey: Survey) -> Iterator[Fit]:
    weight = any(effect.name == "gravity" for effect in survey.model.effects)
    for inertia in survey.fitting("inertia", needs=("load",)):
        torques = [
            q for q in survey.fitting("force", needs=("angle",))
            if weight and q.port.group == inertia.port.group
        ]  # fmt: skip
        yield "", ((inertia, *torques[:1]),)


def _heavier(at: PortView) -> Expression:
    along, above = LOAD_CENTRE
    if at.index == 0:
        return at.value + at.p.mass * (along**2 + above**2 + _OWN_INERTIA)
    angle = at.signals.angle
    lever = along * ca.cos(angle) - above * ca.sin(angle)
    return at.value - at.p.gravity_share * GRAVITY * at.p.mass * lever


load_error = Law(
    "load_error",
    "J = J + mass r^2, T = T - share g mass x cos(theta)",
    _where,
    lambda at: (
        size("mass", "kg", 0.5, 0.05, 8.0, "mass in excess of the notes", signed=True),
        shape("gravity_share", "1", 1.0 if at.others else 0.0,
              "share of gravity in the plane of motion", around=None, between=(-1.0, 1.0),
              scale=1.0, source="", fitted=False),
    ),
    _heavier,
    source="parallel-axis theorem",
    look_alikes=("loose_load", "force_gain"),
    separated_by="weigh the load; free swings with the load taken off",
)  # fmt: skip
