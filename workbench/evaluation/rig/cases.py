"""Make a case: a folder with case.toml and four recordings, plus the truth beside it.

Units: SI, loads in kg; `spread` is relative.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import excitation, plant, simulate
from workbench.evaluation.rig.parameters import EFFECTS, nominal, switch_on

HEADER = "time_s,valve_V,angle_deg,pressure_1_bar,pressure_2_bar"
SPREAD: dict[str, float] = {
    "arm_inertia": 0.03, "force_gain": 0.03, "conductance": 0.04, "centre_leakage": 0.4,
    "volume_gain": 0.02, "dead_volume": 0.25, "viscous": 0.35, "coulomb": 0.25,
    "heat_transfer": 0.25,
}  # fmt: skip
"""Relative half range within which a background parameter leaves its nominal value."""


def background(rng: np.random.Generator, load: float, *, spread: float = 1.0) -> dict[str, float]:
    """Return nominal parameters moved at random by some per cent, times `spread`."""
    p = nominal({"load": load})
    for name, half in SPREAD.items():
        p[name] *= 1.0 + spread * rng.uniform(-half, half)
    return p


def settled(parameters: dict[str, float], *, seconds: float) -> NDArray[np.float64]:
    """Return the state after a pre-history at 5 V from rest at 30 degrees with 3 bar twice."""
    start = plant.initial(30.0, (3.0, 3.0), parameters)
    n = round(seconds / simulate.STEP)
    _, x = plant.run(parameters, start, np.full(n, 5.0), step=simulate.STEP, keep=max(1, n))
    return x


def make_case(
    seed: int,
    effects: list[str],
    load: float,
    folder: Path,
    *,
    sizes: dict[str, float] | None = None,
    load_error: float = 0.0,
    seconds: float = 20.0,
    spread: float = 1.0,
    recorded: str = "all",
) -> Path:
    """Write a case into `folder` and return it; the truth goes to truth.json in it.

    `load` in kg stands in case.toml; the rig carries load + load_error. `spread` widens or narrows
    the background. `recorded` is "all", "closed" (the closed-loop recordings alone) or "narrow"
    (those, along slow sines of a few degrees).
    """
    rng = np.random.default_rng(seed)
    if "wrong_load" in effects and load_error == 0.0:
        load_error = float(rng.choice([-0.8, 0.8]))
    p = switch_on(background(rng, load + load_error, spread=spread), effects, sizes)
    start = settled(p, seconds=2.0)
    # A loop that holds 30 deg during the pre-history leaves nearly the same pressures.
    mean = sum(plant.gauge(start, p)) / 2e5
    held = plant.initial(30.0, (mean, mean), p)
    if p["supply_volume"] > 0.0:
        i = plant.INDEX["reservoir"]
        held[i] = start[i]
    plans = {
        "identify_open": (start, "command", excitation.random_pulses(rng, seconds)),
        "identify_closed": (held, "reference", excitation.random_steps(rng, seconds)),
        "validate_open": (start, "command", excitation.pulse_train(0.8 * seconds)),
        "validate_closed": (held, "reference", excitation.sines(rng, seconds)),
    }
    if recorded != "all":
        plans = {name: row for name, row in plans.items() if row[1] == "reference"}
    if recorded == "narrow":
        plans = {
            name: (state, kind, excitation.slow_sines(rng, len(signal) / excitation.RATE))
            for name, (state, kind, signal) in plans.items()
        }
    folder.mkdir(parents=True, exist_ok=True)
    for name, (state, kind, signal) in plans.items():
        record = simulate.run(p, state, seed=int(rng.integers(2**31)), **{kind: signal})
        np.savetxt(
            folder / f"{name}.csv", record.table(), delimiter=",", header=HEADER, comments="",
            fmt=["%.3f", "%.4f", "%.3f", "%.4f", "%.4f"],
        )  # fmt: skip
    (folder / "case.toml").write_text(
        f'load_kg = {load:g}\nplane = "horizontal"\n'
        f"supply_bar = {p['supply_pressure'] / 1e5:.1f}\nsample_rate_Hz = 500\n"
    )
    truth = {
        "effects": [{"effect": e, "where": EFFECTS[e].where} for e in effects],
        "load_error": load_error,
        "parameters": p,
        "starts": {name: state.tolist() for name, (state, _, _) in plans.items()},
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return folder
