"""A wrong sign is only one where the model follows the recording better with a column reversed."""

from dataclasses import replace
from typing import Any

import numpy as np

from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.diagnosis.misrecorded_columns import with_columns_tried
from workbench.model import Model
from workbench.recordings import check_recording

NAMES = ("direct", "torque", "speed")


def rates(x: Any, u: Any, resistance: Any = 300.0) -> tuple[Any, ...]:
    return (
        600.0 * u[0] - resistance * x[0] + 4.0 * x[2] * x[1],
        600.0 * u[1] - resistance * x[1] - 75.0 * x[2],
        580.0 * x[1] - 2.0 * x[2],
    )


def motor() -> Model:
    def equations(m: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        x = (m.x.direct, m.x.torque, m.x.speed)
        raised = rates(x, (m.u.direct_V, m.u.torque_V), m.p.resistance)
        return dict(zip(NAMES, raised, strict=True)), dict(zip(NAMES, x, strict=True))

    quantities = "direct A, torque A, speed rad/s"
    voltages, resistance = "direct_V V, torque_V V", "resistance 1/s 280 100 900"
    return machine(equations, quantities, voltages, quantities, resistance)


def test_what_takes_a_coupling_away_is_not_reversed() -> None:
    rng, x, rows = np.random.default_rng(1), np.zeros(3), []
    for wanted in np.repeat(rng.uniform(-30.0, 30.0, 10), 120):
        # The drive takes away what the torque's current adds to the other one.
        u = np.array([-4.0 * x[2] * x[1] / 600.0, 0.125 * x[2] + 0.06 * (wanted - x[2])])
        rows.append([*u, *(x + rng.normal(0.0, [0.008, 0.008, 0.06]))])
        for _ in range(20):
            x = x + 5e-5 * np.array(rates(x, u))
    columns = np.transpose(rows)
    commands = dict(zip(("direct_V [V]", "torque_V [V]"), columns, strict=False))
    read = dict(zip(("direct [A]", "torque [A]", "speed [rad/s]"), columns[2:], strict=True))
    trial = recording("motor", 1e-3, commands, read)
    report = check_recording(trial, model=motor())
    assert not report.fit
    tried = with_columns_tried(motor(), report)
    assert tried.fit and "signs" in tried.doubtful
    turned = replace(trial.signal("torque_V"), values=-trial["torque_V"])
    wrong = check_recording(trial.with_signal(turned), model=motor())
    assert with_columns_tried(motor(), wrong) is wrong and not wrong.fit


def test_a_heater_that_answers_to_an_opened_door_is_not_reversed() -> None:
    rng, warmth, rows = np.random.default_rng(321), 310.0, []
    for k in range(1400):
        opened = any(begin <= 5 * k < begin + 40 for begin in (1200, 3100, 5450))
        heat = float(np.clip(44.0 + 60.0 * (310.0 - warmth), 0.0, 120.0))
        rows.append([heat, warmth + rng.normal(0.0, 0.02)])
        for _ in range(50):
            lost = (28.5 if opened else 3.5) * (warmth - 295.0)
            warmth += 0.1 * (heat - lost) / 9500.0
    heater, chamber = np.array(rows).T
    incubator = machine(
        lambda m: (
            {"warmth": (m.u.heater - m.p.loss * (m.x.warmth - 295.0)) / m.p.capacity},
            {"chamber": m.x.warmth},
        ),
        "warmth K 310 scale=10",
        "heater W 0",
        "chamber K",
        "loss W/K 3 0.5 10, capacity J/K 8000 2000 4e4",
    )
    trial = recording("incubator", 5.0, {"heater [W]": heater}, {"chamber [K]": chamber})
    report = check_recording(trial, model=incubator)
    assert not report.fit
    assert with_columns_tried(incubator, report).fit
