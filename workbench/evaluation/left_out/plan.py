"""Which physics is left out of which plant, on which data, and which answers are right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from workbench.evaluation.left_out.isometric import isometric_recording
from workbench.evaluation.rig.cases import make_case
from workbench.model import Model
from workbench.physics.gas_energy import isothermal_gas
from workbench.plants.arm import arm, pneumatic_muscle
from workbench.plants.arm.volume_effects import constant_volume
from workbench.recordings import Recording, read_case

LOAD_KG = 3.0
SEED = 11

Experiment = Literal["isometric", "motion"]


@dataclass(frozen=True)
class LeftOut:
    """A piece of the paper's physics that a nominal plant lacks.

    Args:
        answers: Names in the library that are right; none where nothing is left out.
        collinear: Whether parameters reproduce most of it, so that silence is right as well.
        seconds: Length of a recording of the arm, in s.
        tried: Names of the effects that compete; the whole library if none.
    """

    physics: str
    experiment: Experiment
    nominal: Callable[[], Model]
    answers: tuple[str, ...]
    collinear: bool = False
    seconds: float = 10.0
    tried: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the case, such as ``phi-isometric``."""
        return f"{self.physics.replace(' ', '-')}-{self.experiment}"


def _arm() -> Model:
    return arm(LOAD_KG)


PLAN: tuple[LeftOut, ...] = (
    LeftOut("nothing", "motion", _arm, ()),
    LeftOut(
        "phi", "isometric", lambda: pneumatic_muscle().without("force_correction"), ("phi_term",)
    ),
    LeftOut("phi", "motion", lambda: _arm().without("force_correction"), ("phi_term",)),
    LeftOut(
        "changing volume",
        "motion",
        lambda: _arm().without("end_flattening").with_effect(constant_volume()),
        ("braid_volume",),
    ),
    LeftOut(
        "flattened ends",
        "motion",
        lambda: _arm().without("end_flattening"),
        ("flattened_ends",),
        collinear=True,
    ),
    LeftOut(
        "energy of the gas",
        "motion",
        lambda: (
            _arm()
            .without("heat_exchange")
            .with_effect(isothermal_gas(("chamber_1.heat", "chamber_2.heat")))
        ),
        ("gas_energy_balance",),
    ),
    LeftOut(
        "Coulomb friction",
        "motion",
        lambda: _arm().without("bearing_friction"),
        ("coulomb_friction",),
    ),
)
"""Every piece, after a control in which nothing is left out."""


def recordings(case: LeftOut, folder: Path) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Record on the independent rig, whose parameters are some per cent off.

    Returns:
        Recordings to fit on and others to judge on: isometric ramps of a muscle, or the arm in
        motion, open and closed loop.
    """
    if case.experiment == "isometric":
        return (_ramps("fitted", (0, 5, 11, 18, 26), 1),), (_ramps("held out", (2, 8, 22), 2),)
    made = read_case(make_case(SEED, [], LOAD_KG, folder, seconds=case.seconds))
    return tuple(made.fit.values()), tuple(made.hold_out.values())


def _ramps(name: str, contractions_mm: Sequence[float], seed: int) -> Recording:
    return isometric_recording(
        contractions_mm, seed=seed, name=name, parameters={"force_gain": 1.03, "dead_volume": 18e-6}
    )
