"""Recorded cases beside the simulation of the same valve voltage."""

from __future__ import annotations

import numpy as np

from workbench.data_folder import shipped_cases, shipped_data
from workbench.demo.part import Part
from workbench.demo.replay import FIRST_SAMPLES, Replay, replay
from workbench.physics.hysteresis import bouc_wen_hysteresis
from workbench.plants.arm import arm
from workbench.plants.arm.inertia import Plane
from workbench.recordings import Case, Recording, read_case
from workbench.reports.figures.recorded_case import recorded_case
from workbench.reports.page import Commands, Method, Section, Words
from workbench.reports.pictures import Picture
from workbench.reports.tables import Table, number

SHOWN = "validate_open"
"""The recording that is drawn: the pulse train, run from stop to stop."""

_DRAWN_SECONDS = 7.0


def models_of(case: Case) -> dict[str, object]:
    """Build the models that a case is compared with.

    Args:
        case: The case, with load, plane and supply.

    Returns:
        Models by what they are.

    Example:
        >>> list(models_of(read_case(shipped_data("practice-08"))))
        ['nominal', 'nominal with muscle hysteresis']
    """
    plane: Plane = "vertical" if case.plane == "vertical" else "horizontal"
    nominal = arm(case.load_kg, plane=plane, supply_bar=case.supply_bar)
    return {
        "nominal": nominal,
        "nominal with muscle hysteresis": nominal.with_effect(bouc_wen_hysteresis()),
    }


def recorded_case_part() -> Part:
    """Replay the open-loop recordings of the shipped cases.

    Returns:
        The section and its numbers.

    Example:
        >>> found = recorded_case_part().results["practice-08"]
        >>> rms = [numbers["angle_rms_deg"] for numbers in found.values()]
        >>> rms[0] > 1.2 * rms[1]  # the muscles of this rig have hysteresis
        True
    """
    blocks: list[Picture] = []
    rows: list[tuple[str, ...]] = []
    results: dict[str, dict[str, dict[str, float]]] = {}
    for name in shipped_cases():
        case = read_case(shipped_data(name))
        recording = case.recordings[SHOWN]
        results[name] = {}
        for title, model in models_of(case).items():
            found = replay(model, recording)  # type: ignore[arg-type]
            results[name][title] = _numbers(found)
            rows.append((name, title, *(number(v, 2) for v in results[name][title].values())))
            if title == "nominal":
                blocks.append(_picture(name, found))
    return Part(_section(blocks, rows), results)


def _numbers(found: Replay) -> dict[str, float]:
    return {
        "angle_rms_deg": float(np.degrees(found.rms("angle"))),
        "angle_largest_deg": float(np.degrees(np.nanmax(np.abs(found.difference("angle"))))),
        "pressure_1_rms_bar": found.rms("pressure_1") / 1e5,
        "pressure_2_rms_bar": found.rms("pressure_2") / 1e5,
    }


def _picture(name: str, found: Replay) -> Picture:
    recording, run = found.recording, found.trajectory
    seen = recording.time <= recording.time[0] + _DRAWN_SECONDS
    figure = recorded_case(
        recording.time[seen],
        recording["valve"][seen],
        _columns(recording, seen),
        (run["angle"][seen], run["pressure_1"][seen], run["pressure_2"][seen]),
    )
    return Picture(
        f"recorded-{name}",
        figure,
        f"{name}, {SHOWN}: what was measured and what the nominal model answers to the same valve "
        f"voltage, first {_DRAWN_SECONDS:g} s.",
        "valve voltage, measured and simulated angle, their difference, and both pressures",
    )


def _columns(
    recording: Recording, seen: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        recording["angle"][seen],
        recording["pressure_1"][seen],
        recording["pressure_2"][seen],
    )


def _section(pictures: list[Picture], rows: list[tuple[str, ...]]) -> Section:
    return Section(
        "recorded",
        "Recorded cases",
        (
            Words(
                "Two recordings of an arm of this kind ship with the workbench. The simulation "
                "gets the recorded valve voltage and nothing else: it runs freely to the end with "
                "the nominal parameters, so their deviations of some per cent and whatever "
                "physics the model leaves out add up in the difference."
            ),
            Words(
                "In practice-07 only parameters differ from nominal; in practice-08 the muscles "
                "also have hysteresis. Adding the hysteresis effect with its default sizes is "
                "shown for comparison; nothing has been fitted to these recordings here, so a "
                "smaller or larger difference is no verdict about the physics yet.",
                "note",
            ),
            *pictures,
            Table(
                "Measured minus simulated, whole recording",
                (
                    "case",
                    "model",
                    "angle, rms in °",
                    "angle, largest in °",
                    "pressure 1, rms in bar",
                    "pressure 2, rms in bar",
                ),
                tuple(rows),
            ),
            Method(
                (
                    (
                        "start",
                        f"angle and pressures from the mean of the first {FIRST_SAMPLES} samples, "
                        "at rest, gas at ambient temperature, spool where the first voltage holds "
                        "it",
                    ),
                    ("rms", "root mean square over all samples of the recording"),
                    ("largest", "largest absolute difference of all samples"),
                )
            ),
            Commands(
                (
                    'python -c "from workbench.demo.recorded_case import recorded_case_part; '
                    'print(recorded_case_part().results)"',
                )
            ),
        ),
    )
