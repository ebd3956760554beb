"""Linear models over angles and loads: modes, Bode plots and how far they hold."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from workbench.demo.part import Part, judged, section
from workbench.errors import WorkbenchError
from workbench.files import picked
from workbench.linearisation import LinearModel, linearise
from workbench.linearisation.operating_map import operating_map
from workbench.linearisation.transfer import frequency_response
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.reports.figures.bode_nyquist import bode
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, Table, number

ANGLES_DEG = (0, 10, 20, 30, 40, 50, 60)
LOADS_KG = (0, 3, 8)
MEAN_PRESSURE = 3e5
DRAWN_LOAD_KG = 3
FREQUENCY = np.geomspace(0.05, 20.0, 300)

BANDS_HZ = {0: (5.0, 6.6), 3: (1.7, 2.3), 8: (1.1, 1.5)}
"""Smallest and largest frequency of the swing of the arm by load, in Hz."""

BAND_DAMPING = (0.01, 0.2)


def linear_models() -> dict[tuple[int, int], LinearModel]:
    """Linearise the arm over loads (in kg) and angles (in °), with the valve's opening as input.

    Bearing friction is left out: at rest its slope looks like strong damping, which a moving arm
    does not have.
    """
    found = operating_map(
        arm().without("bearing_friction"),
        {"angle": np.radians(ANGLES_DEG), "load": LOADS_KG, "mean_pressure": [MEAN_PRESSURE]},
    )
    if found.reasons:
        raise WorkbenchError(next(iter(found.reasons.values())))
    return {(LOADS_KG[j], ANGLES_DEG[i]): model for (i, j, _), model in found.models.items()}


def angle_map_part() -> Part:
    """Linearise the arm over angles and loads.

    Example:
        >>> angle_map_part().marks  # seven angles, three loads
        {'met': 21, 'missed': 0, 'open': 0}
    """
    models = linear_models()
    sided = linearise(
        operating_point(
            arm(DRAWN_LOAD_KG), {"angle": math.radians(30), "mean_pressure": MEAN_PRESSURE}
        )
    )
    verdict = sided.verdict
    assert verdict is not None
    kink = verdict.kinks[0]
    said = [str(kink), str(verdict.amplitude), str(verdict.frequency)]
    kinds = ("kink", "size of a step", "frequency of a sine")
    modes = {
        f"{load} kg": {f"{angle} deg": _mode(models[load, angle]) for angle in ANGLES_DEG}
        for load in LOADS_KG
    }
    kinked = picked(kink, "of below=slope_below above=slope_above factor")
    shown = (text.replace(" deg", "°").replace("-> ", "→ ") for text in said)
    blocks = (
        _bode(
            "bode-angles",
            {f"{angle}°": models[DRAWN_LOAD_KG, angle] for angle in ANGLES_DEG},
            f"From the valve's opening to the angle with {DRAWN_LOAD_KG} kg, at seven angles;"
            " those that mirror each other about 30° have the same curve.",
            "magnitude and phase with a resonance near 2 hertz",
        ),
        _bode(
            "bode-loads",
            {f"{load} kg": models[load, 30] for load in LOADS_KG},
            "From the valve's opening to the angle at 30° with three loads.",
            "magnitude and phase; the resonance moves from 6 to 1.3 hertz with the load",
        ),
        _modes(modes),
        Table(
            f"How far the linear model holds at 30° with {DRAWN_LOAD_KG} kg, valve voltage as "
            "the input",
            ("what", "verdict"),
            tuple(zip(kinds, shown, strict=True)),
            "At rest the valve stands on a kink of its curve: filling and venting have "
            "different slopes, and the matrices hold their mean.",
        ),
    )
    command = "workbench linearise --angle 30deg --load 3kg --mean-pressure 3bar --verdict"
    told = section("linear-models", "Linear models over the angles", "angle_map", blocks, command)
    return Part(told, {"modes": modes, "kink": kinked, "verdict": said})


def _bode(name: str, models: dict[str, LinearModel], caption: str, words: str) -> Picture:
    """Draw the responses from the valve's opening, in per cent, to the angle, in °."""
    per_cent = math.degrees(1.0) / 100.0
    responses = {
        title: per_cent * frequency_response(linear, "angle", FREQUENCY)
        for title, linear in models.items()
    }
    return Picture(name, bode(FREQUENCY, responses, unit="° per % opening"), caption, words)


def _mode(linear: LinearModel) -> dict[str, float]:
    mode, point = linear.mode_of("angle"), linear.operating_point
    return {
        "frequency_Hz": mode.frequency_hz,
        "damping": mode.damping,
        "pressure_1_bar": point["pressure_1"] / 1e5,
        "pressure_2_bar": point["pressure_2"] / 1e5,
    }


def _modes(modes: dict[str, dict[str, dict[str, float]]]) -> Table:
    def of(load: int, angle: int) -> dict[str, float]:
        return modes[f"{load} kg"][f"{angle} deg"]

    def swing(load: int, angle: int) -> Cell:
        frequency = judged(of(load, angle)["frequency_Hz"], *BANDS_HZ[load])
        damping = judged(of(load, angle)["damping"], *BAND_DAMPING, digits=2)
        met = frequency.mark == damping.mark == "met"
        return Cell(f"{frequency.text} Hz, ζ {damping.text}", "met" if met else "missed")

    def pressures(angle: int) -> str:
        own = of(DRAWN_LOAD_KG, angle)
        return " / ".join(number(own[f"pressure_{i}_bar"]) for i in (1, 2))

    bands = ", ".join(f"{low:g} … {high:g} Hz ({kg} kg)" for kg, (low, high) in BANDS_HZ.items())
    return Table.of(
        "Swing of the arm",
        ANGLES_DEG,
        {
            "angle in °": str,
            "muscle 1 / 2 in bar": pressures,
            **{f"{load} kg": partial(swing, load) for load in LOADS_KG},
        },
        f"Must lie in {bands}; damping ratio ζ in {BAND_DAMPING[0]:g} … {BAND_DAMPING[1]:g}.",
    )
