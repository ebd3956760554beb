"""Replay recorded commands on the rig with the true parameters and compare."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.evaluation.rig import plant
from workbench.evaluation.rig.electronics import Sensors
from workbench.evaluation.rig.parameters import elements, nominal

NAMES = {
    "J_arm": "arm_inertia", "kF": "force_gain", "C": "conductance", "leak": "centre_leakage",
    "V_gain": "volume_gain", "V_dead": "dead_volume", "c_visc": "viscous", "tau_c": "coulomb",
    "h_heat": "heat_transfer", "res_V": "supply_volume", "res_C": "supply_linear",
    "leak2": "leak_2", "tau_brk": "stribeck_torque", "v_s": "stribeck_speed", "tilt": "tilt",
    "hyst_F0": "hyst_force", "hyst_cp": "hyst_slope",
}  # fmt: skip
PREHISTORY, START_BAR = 2.0, 3.0
"""Each open-loop recording is preceded by 2 s at 5 V from 30 deg and 3 bar in both muscles."""


@dataclass(frozen=True)
class Comparison:
    """Root mean square of simulated minus measured: angle in deg, pressures in mbar."""

    angle: float
    pressure: float


def truth(folder: Path, case: str) -> dict[str, float]:
    """Return the rig parameters of a practice case from its key."""
    entry = json.loads((folder / "key.json").read_text())[case]
    p = nominal({"load": entry["load"]})
    for name, value in entry["background"].items():
        if name == "centre":
            p["valve_centre"] = 5.0 - value
        else:
            p[NAMES[name]] = value
    if p["hyst_force"] > 0.0:
        p.update(elements(0.216e-3, 4.108e-3, 10))
    lag = next((e["parameters"].get("_p_lag", 0.0) for e in entry["truth"]), 0.0)
    p["pressure_lag"] = lag
    return p


def replay(
    folder: Path, case: str, recording: str, *, step: float = 1e-4, **changes: float
) -> Comparison:
    """Simulate an open-loop recording from its valve voltage, after the pre-history."""
    p = truth(folder, case) | changes
    data = np.loadtxt(folder / case / f"{recording}.csv", delimiter=",", skiprows=1)
    u = 5.0 + np.round((data[:, 1] - 5.0) / p["command_step"]) * p["command_step"]
    x = plant.initial(30.0, (START_BAR, START_BAR), p)
    per = round(2e-3 / step)
    n = round(PREHISTORY / step)
    _, x = plant.run(p, x, np.full(n, 5.0), step=step, keep=n)
    states, _ = plant.run(p, x, np.repeat(u, per), step=step, keep=per)
    sensors = Sensors(p | {"pressure_noise": 0.0, "pressure_step": 0.0}, np.random.default_rng(0))
    true = [plant.gauge(x, p) for x in states]
    bars = np.array([[sensors.pressure(k, row) / 1e5 for k in (0, 1)] for row in true])
    e_angle = np.degrees(states[:, 0]) - data[:, 2]
    e_bar = bars - data[:, 3:]
    return Comparison(float(np.sqrt(np.mean(e_angle**2))), 1e3 * float(np.sqrt(np.mean(e_bar**2))))
