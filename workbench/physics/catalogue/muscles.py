"""Entries for pneumatic muscles: hysteresis, creep, viscosity, tendons, force shape, volume."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import Model
from workbench.physics.braid_volume import braid_volume, flattened_ends
from workbench.physics.creep import creep
from workbench.physics.force_shape import (
    contraction_force_correction,
    force_shape,
    phi_term,
    pressure_force_correction,
)
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.hysteresis import bouc_wen_hysteresis
from workbench.physics.load_friction import load_dependent_friction
from workbench.physics.maxwell_slip import maxwell_slip_hysteresis
from workbench.physics.muscle_viscosity import muscle_viscosity
from workbench.physics.offset_gain import gain
from workbench.physics.series_elasticity import series_elasticity


def entries(model: Model) -> Iterator[Hypothesis]:
    """Yield what muscles may lack.

    Args:
        model: The model; its muscles are the ports ``*.force``, ``*.tension`` and ``*.volume`` with
            the local signals of a muscle.

    Example:
        >>> from workbench.plants.arm import arm
        >>> next(entries(arm())).ports
        ('muscle_1.force', 'muscle_2.force')
    """

    def having(ending: str, *signals: str) -> tuple[str, ...]:
        return tuple(
            q.name
            for q in model.ports
            if q.name.endswith(ending) and set(signals) <= set(q.signals)
        )

    forces = having(".force", "contraction_speed", "gauge_pressure")
    if forces:
        yield from _forces(forces)
    tensions = having(".tension", "contraction", "gauge_pressure")
    if tensions:
        yield from _tensions(tensions)
    volumes = having(".volume", "fibre_length")
    if volumes:
        yield Hypothesis(flattened_ends(volumes, share=0.0), "share", 1.0, 0.3)
        if any(effect.about.equation.startswith("V = constant") for effect in model.effects):
            yield Hypothesis(braid_volume(volumes, share=0.0), "share", 1.0, 0.3)


def _forces(ports: tuple[str, ...]) -> Iterator[Hypothesis]:
    yield Hypothesis(
        maxwell_slip_hysteresis(ports, level=0.0),
        "level",
        10.0,
        2.0,
        shapes=({"breakaway": 2.5e-4},),
    )
    yield Hypothesis(
        bouc_wen_hysteresis(ports, level=0.0, level_per_pressure=0.0),
        "level_per_pressure",
        7e-5,
        5e-6,
        law="muscle_hysteresis",
        shapes=(
            {"breakaway": 5e-4},
            {"breakaway": 2e-3},
            {"breakaway": 5e-4, "exponent": 2.0},
        ),
    )
    yield Hypothesis(
        creep(ports, share=0.0),
        "share",
        0.02,
        0.003,
        shapes=({"time_constant": 1.0}, {"time_constant": 0.3}, {"slow_part": 1.0}),
    )
    yield Hypothesis(muscle_viscosity(ports, coefficient=0.0), "coefficient", 300.0, 20.0)
    yield Hypothesis(
        load_dependent_friction(
            ports,
            coefficient=0.0,
            loads=("gauge_pressure",),
            speed_signal="contraction_speed",
            transition_speed=1e-3,
            unit="N",
            load_unit="Pa",
            speed_unit="m/s",
            upper=5e-4,
            typical=7e-5,
            name="pressure_friction",
        ),
        "coefficient",
        7e-5,
        5e-6,
    )
    for port in ports:
        number = port.split(".")[0].rpartition("_")[2]
        yield Hypothesis(
            gain(
                (port,),
                excess=0.0,
                typical=0.05,
                look_alikes=("tilt_gravity", "constant_torque", "sensor_gain", "force_gain"),
                separated_by="isometric force of each muscle with a load cell",
                name=f"force_gain_{number}",
            ),
            "excess",
            0.05,
            0.01,
            law="force_gain",
        )


def _tensions(ports: tuple[str, ...]) -> Iterator[Hypothesis]:
    yield Hypothesis(series_elasticity(ports, compliance=0.0), "compliance", 7e-6, 1e-6, far=True)
    yield Hypothesis(force_shape(ports, share=0.0), "share", 0.5, 0.05)
    yield Hypothesis(contraction_force_correction(ports, gain=0.0), "gain", 0.1, 0.02)
    yield Hypothesis(pressure_force_correction(ports, gain=0.0), "gain", 0.05, 0.01)
    yield Hypothesis(phi_term(ports, share=0.0), "share", 1.0, 0.1)
