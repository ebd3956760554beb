"""Exchanged columns, and a time in another unit than its column says, along any plant."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.diagnosis.misrecorded_columns import with_columns_tried
from workbench.model import Model
from workbench.recordings import Recording, check_recording


def room() -> tuple[Model, Recording]:
    def rate(air: Any, heater: Any, outside: Any, loss: Any, capacity: Any) -> Any:
        return (heater - loss * (air - outside)) / capacity

    rng, air, rows = np.random.default_rng(3), 293.0, []
    for k in range(600):
        heat = 500.0 + 450.0 * (np.sin(0.7 * np.sqrt(k)) > 0.0) * rng.uniform(0.9, 1.0)
        outside = 278.0 + 4.0 * np.sin(2e-2 * k)
        rows.append([heat, outside, air + rng.normal(0.0, 0.05)])
        for _ in range(10):
            air += 6.0 * rate(air, heat, outside, 45.0, 4e4)
    plant = machine(
        lambda m: (
            {"air": rate(m.x.air, m.u.heater, m.u.outside, m.p.loss, m.p.capacity)},
            {"inside": m.x.air},
        ),
        "air K 293 scale=5",
        "heater W 0, outside K 278",
        "inside K",
        "loss W/K 40 10 200, capacity J/K 5e4 1e4 2e5",
    )
    heater, out, inside = np.transpose(rows)
    commands = {"heater [W]": heater, "outside [K]": out}
    return plant, recording("room", 60.0, commands, {"inside [K]": inside})


def circuit() -> tuple[Model, Recording]:
    rng, current, voltage, rows = np.random.default_rng(5), 0.0, 0.0, []
    for source in np.repeat(rng.uniform(-10.0, 10.0, 60), 10):
        rows.append([source, *(np.array([voltage, current]) + rng.normal(0.0, 2e-3, 2))])
        for _ in range(20):
            rise = (source - voltage - 3.0 * current) / 0.02
            current, voltage = current + 5e-5 * rise, voltage + 5e-5 * current / 4e-4
    plant = machine(
        lambda m: (
            {
                "current": (m.u.source - m.x.voltage - m.p.resistance * m.x.current) / 0.02,
                "voltage": m.x.current / m.p.capacity,
            },
            {"drop": m.x.voltage, "flow": m.x.current},
        ),
        "current A 0, voltage V 0",
        "source V 0",
        "drop V, flow A",
        "resistance Ohm 2 0.5 20, capacity F 5e-4 1e-4 1e-3",
    )
    source, drop, _ = np.transpose(rows)
    # Nobody recorded the current.
    return plant, recording("circuit", 1e-3, {"source [V]": source}, {"drop [V]": drop})


def exchanged(trial: Recording, one: str, other: str) -> Recording:
    first, second = trial.signal(one), trial.signal(other)
    changed = trial.with_signal(replace(first, values=second.values))
    return changed.with_signal(replace(second, values=first.values))


@pytest.mark.long
@pytest.mark.parametrize(
    ("made", "columns", "unit", "factor"),
    [(room, ("outside", "inside"), "min", 60.0), (circuit, ("source", "drop"), "ms", 1e-3)],
)
def test_columns_that_are_misread_are_told(
    made: Any, columns: tuple[str, str], unit: str, factor: float
) -> None:
    plant, trial = made()
    judged = partial(check_recording, model=plant, required=trial.names)
    good = judged(trial)
    assert good.fit and with_columns_tried(plant, good) is good
    timed = judged(replace(trial, time=trial.time / factor))
    found = with_columns_tried(plant, timed).check("time base")
    # What no machine can do is told by the check alone.
    assert found.result == "unfit" and (not timed.fit or f"counts {unit}, not s" in found.note)
    mixed = judged(exchanged(trial, *columns))
    found = with_columns_tried(plant, mixed).check("signs")
    assert mixed.fit and found.result == "unfit"
    assert f"{columns[0]} and {columns[1]} are exchanged" in found.note
