"""Recorded cases beside the simulation of the same valve voltage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from workbench.data_folder import shipped_cases, shipped_data
from workbench.demo.figures.recorded_case import recorded_case
from workbench.demo.part import Part
from workbench.diagnosis.estimation.free_run import FreeRun, free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.estimation.start import fitted_start
from workbench.model import Model
from workbench.physics.maxwell_slip import maxwell_slip_hysteresis
from workbench.recordings import Case, read_case
from workbench.reports.page import Commands, Method, Section, Words
from workbench.reports.pictures import Picture
from workbench.reports.tables import Table, number

Vector = npt.NDArray[np.float64]

SHOWN = "validate_open"
"""The recording that is drawn: the pulse train, run from stop to stop."""

_DRAWN_SECONDS = 7.0
_START_SAMPLES = 251

_FITTED_SECONDS = 6.0
"""How much of each fitting recording is used: the rest tells the parameters no better."""


def _models_of(case: Case) -> dict[str, Model]:
    """Build the models that a case is compared with; refits know the fitting recordings only."""
    nominal = case.model()
    rough = nominal.with_effect(maxwell_slip_hysteresis())
    return {
        "nominal": nominal,
        "refitted": _refitted(nominal, case),
        "refitted with muscle hysteresis": _refitted(rough, case),
    }


def _refitted(model: Model, case: Case) -> Model:
    seen = [observe(model, r) for r in case.fit.values()]
    count = round(_FITTED_SECONDS / seen[0].sample_time)
    heads = [replace(r, inputs=r.inputs[:count], outputs=r.outputs[:count]) for r in seen]
    return refit(model, heads).model


def recorded_case_part(names: Sequence[str] = ()) -> Part:
    """Replay the open-loop recordings of shipped cases.

    Args:
        names: Names of the cases; all that are shipped by default.

    Returns:
        The section and its numbers.
    """
    blocks: list[Picture] = []
    rows: list[tuple[str, ...]] = []
    results: dict[str, dict[str, dict[str, float]]] = {}
    for name in names or shipped_cases():
        case = read_case(shipped_data(name))
        recording = case.recordings[SHOWN]
        results[name] = {}
        for title, model in _models_of(case).items():
            seen = observe(model, recording)
            found = free_run(model, fitted_start(model, seen, samples=_START_SAMPLES))
            results[name][title] = _numbers(found)
            rows.append((name, title, *(number(v, 2) for v in results[name][title].values())))
            if title in ("nominal", "refitted"):
                blocks.append(_picture(name, title, found, recording["valve"]))
    return Part(_section(blocks, rows), results)


def _numbers(found: FreeRun) -> dict[str, float]:
    rms = found.rmse
    return {
        "angle_rms_deg": float(np.degrees(rms["angle"])),
        "angle_largest_deg": float(np.degrees(np.nanmax(np.abs(_of(found, "angle")[2])))),
        "pressure_1_rms_bar": rms["pressure_1"] / 1e5,
        "pressure_2_rms_bar": rms["pressure_2"] / 1e5,
    }


def _of(found: FreeRun, name: str) -> tuple[Vector, Vector, Vector]:
    column = found.used.index(name)
    return found.measured[:, column], found.simulated[:, column], found.error[:, column]


def _picture(name: str, title: str, found: FreeRun, voltage: Vector) -> Picture:
    seen = found.time <= _DRAWN_SECONDS
    signals = [_of(found, n) for n in ("angle", "pressure_1", "pressure_2")]
    measured, simulated = ([s[i][seen] for s in signals] for i in (0, 1))
    figure = recorded_case(
        found.time[seen],
        voltage[seen],
        (measured[0], measured[1], measured[2]),
        (simulated[0], simulated[1], simulated[2]),
    )
    return Picture(
        f"recorded-{name}-{title}",
        figure,
        f"{name}, {SHOWN}: what was measured and what the {title} model answers to the same valve "
        f"voltage, first {_DRAWN_SECONDS:g} s. This recording was not used for refitting.",
        "valve voltage, measured and simulated angle, their difference, and both pressures",
    )


def _section(pictures: list[Picture], rows: list[tuple[str, ...]]) -> Section:
    return Section(
        "recorded",
        "Recorded cases",
        (
            Words(
                "Two recordings of an arm of this kind ship with the workbench. The simulation "
                "gets the recorded valve voltage and nothing else: it runs freely to the end, "
                "first with the nominal parameters, then with parameters refitted on the first "
                f"{_FITTED_SECONDS:g} s of two other recordings of the same case, so that what "
                "remains is not a wrong number but physics that the model leaves out."
            ),
            Words(
                "In practice-07 only parameters differ from nominal, and the refitted model runs "
                "within the noise of the sensors. In practice-08 the muscles also have hysteresis: "
                "no parameters make up for it, while the model with a hysteresis effect comes "
                "close. Finding out which effect it is, without being told, is the task of the "
                "diagnosis.",
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
                        "fitted to the first half second: no sensor reads speed, gas temperatures "
                        "and spool",
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
