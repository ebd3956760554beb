"""Every reader and every file that users keep: an example of it, how it gets damaged, who reads."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.damage import damaged, damaged_json, damaged_toml
from tests.recordings.example import example_recording
from tests.study.gate import STUDY
from workbench.data_folder import shipped_folder
from workbench.evaluation.answer_key import (
    check_commitments,
    commitments,
    read_key,
    read_names,
    words_of,
)
from workbench.evaluation.blind_round import read_answer
from workbench.plants.registry import PLANTS
from workbench.recordings import (
    check_recording,
    read_case,
    read_recording,
    read_table,
    write_recording,
)
from workbench.recordings.column_matching import driven_by
from workbench.study.baseline import bless, box_changes, changes, read_baseline
from workbench.study.conditions import condition_changes
from workbench.study.execution import Store
from workbench.study.read import load_study, shipped_study
from workbench.verification.metrics import tolerance_of
from workbench.verification.signals import Recorded

TRIAL = example_recording(seconds=2.0)[:250]


@dataclass(frozen=True)
class Subject:
    """A kind of file.

    Args:
        name: Its name in the folder.
        make: Writes a good one and returns its content.
        damage: Returns a content damaged by a seed.
        read: Reads it; raises only what a user is told.
        sure: Whether a damaged one never raises: it is as good as none.
    """

    name: str
    make: Callable[[Path], bytes]
    damage: Callable[[bytes, int], bytes]
    read: Callable[[Path], Any]
    sure: bool = False


def of_text(content: bytes, seed: int) -> bytes:
    """Damage text."""
    return damaged(content, seed, text=True)


def of_bytes(content: bytes, seed: int) -> bytes:
    """Damage what is no text."""
    return damaged(content, seed, text=False)


def csv(_: Path) -> bytes:
    """Return a table as a logger writes it."""
    table = np.column_stack(
        [
            TRIAL.time,
            TRIAL["valve"],
            np.rad2deg(TRIAL["angle"]),
            TRIAL["pressure_1"] / 1e5,
            TRIAL["pressure_2"] / 1e5,
        ]
    )
    rows = "\n".join(",".join(f"{v:.4f}" for v in row) for row in table)
    return f"time_s,valve_V,angle_deg,pressure_1_bar,pressure_2_bar\n{rows}\n".encode()


def german(folder: Path) -> bytes:
    """Return it with commas in its numbers."""
    return csv(folder).replace(b",", b";").replace(b".", b",")


def packed(folder: Path) -> bytes:
    """Return it compressed."""
    return gzip.compress(csv(folder), mtime=0)


def own(folder: Path) -> bytes:
    """Return a recording as the workbench writes it."""
    return write_recording(TRIAL, folder / "own.csv").read_bytes()


def mat_5(folder: Path) -> bytes:
    """Return a MATLAB file with a structure."""
    from scipy.io import savemat

    savemat(folder / "a.mat", {"t": TRIAL.time, "u": TRIAL["valve"], "s": {"q": TRIAL["angle"]}})
    return (folder / "a.mat").read_bytes()


def matlab_plant(folder: Path) -> bytes:
    """Return a MATLAB file with a system."""
    from scipy.io import savemat

    system = {"A": -np.eye(2), "B": np.ones((2, 1)), "C": np.ones((1, 2)), "inputs": "push"}
    savemat(folder / "plant.mat", system)
    return (folder / "plant.mat").read_bytes()


def mat_73(folder: Path) -> bytes:
    """Return a MATLAB file that is an HDF5 file."""
    import h5py

    with h5py.File(folder / "b.mat", "w") as file:
        file["t"], file["u"] = TRIAL.time.reshape(1, -1), TRIAL["valve"].reshape(1, -1)
    return (folder / "b.mat").read_bytes()


def parquet(folder: Path) -> bytes:
    """Return a Parquet file with typed instants."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    stamps = pa.array((1e9 * TRIAL.time).astype("int64"), pa.timestamp("ns"))
    pq.write_table(pa.table({"t": stamps, "u": TRIAL["valve"]}), folder / "a.parquet")
    return (folder / "a.parquet").read_bytes()


def log(_: Path) -> bytes:
    """Return a log in JSON."""
    entries = [
        {"t": t, "q": q, "on": True}
        for t, q in zip(TRIAL.time.tolist(), TRIAL["angle"].tolist(), strict=True)
    ]
    return json.dumps({"mass": 0.5, "entries": entries}).encode()


def recording(path: Path) -> None:
    """Read and check a recording; what is fit is whole."""
    found = check_recording(read_recording(path))
    if found.fit:
        assert found.recording.increasing
        assert np.isfinite(found.recording.matrix(found.recording.names)).all()


def of_a_plant(path: Path) -> None:
    """Read and check a recording of the arm."""
    model = PLANTS.get("arm").model({})
    seen = read_recording(path, signals=driven_by(model))
    required = [q.name for q in (*model.inputs, *model.outputs) if q.name in seen]
    str(check_recording(seen, model=model, required=required))


MAPPING = b"""[time]
column = "time_s"
unit = "s"
factor = 1.0

[signals.valve]
column = "valve_V"
unit = "V"
sign = -1

[signals.angle]
column = "angle_deg"
unit = "deg"
offset = 1.5
"""
CASE = b"""title = "an arm"
plant = "arm"

[options]
load = "3 kg"
plane = "horizontal"

[[recordings]]
files = ["a.csv"]
use = "fit"
resample_Hz = 250

[[recordings]]
files = ["b.csv"]
use = "hold_out"
mapping = { signals = { valve = { column = "valve_V", unit = "V" } } }

[refit]
starts = 2
start_samples = 5
noise = { angle = "0.1 deg" }
stages = [1.0, 0.1]
"""


def mapped(path: Path) -> None:
    """Read a recording by a mapping."""
    (path.parent / "data.csv").write_bytes(csv(path))
    check_recording(read_recording(path.parent / "data.csv", mapping=path))


def case(path: Path) -> None:
    """Read a case with two recordings."""
    for name in ("a.csv", "b.csv", "identify_open.csv"):
        (path.parent / name).write_bytes(csv(path))
    found = read_case(path.parent)
    str(found)
    found.plant.model(found.options, **found.changes)


def baseline(path: Path) -> None:
    """Compare with a baseline, and its conditions with others."""
    found = read_baseline(path)
    names = {n for r in found.records.values() if r.metrics for n in r.metrics}
    rules = {name: tolerance_of(name) for name in names}
    changes(rules, found.records.values(), found)
    box_changes(BOX, found)
    if found.conditions is not None:
        condition_changes(found.conditions, CONDITIONS)
        condition_changes(CONDITIONS, found.conditions)


def accepted(path: Path) -> None:
    """Accept results, as the first baseline and over one that is there."""
    folder = path.parent / "results"
    folder.mkdir(exist_ok=True)
    path.replace(folder / "results.json")
    kept = path.parent / "kept.json"
    try:
        bless(folder, kept)
        bless(folder, kept)
    finally:
        kept.unlink(missing_ok=True)


def key(path: Path) -> None:
    """Read an answer key."""
    names = read_names()
    for name, answer in read_key(path).items():
        commitments(answer)
        names.truths(name, words_of(answer))


def kept_run(path: Path) -> None:
    """Read a finished run; a damaged one is as good as none."""
    Store(path.parent, "code").get(path.stem)


def fixed(content: Any) -> Callable[[Path], bytes]:
    """Return what makes the same file every time."""
    data = content if isinstance(content, bytes) else json.dumps(content).encode()
    return lambda _: data


RUN = {
    "controller": "pid",
    "variation": "nominal",
    "scenario": "step",
    "seed": 1,
    "status": "done",
    "reason": "",
    "seconds": 0.1,
    "metrics": {
        "rmse": {"value": 0.02, "unit": "rad", "reason": "", "display_unit": "deg"},
        "settling_time": {"value": None, "unit": "s", "reason": "it never settles"},
    },
    "steps": [
        {"output": "angle", "begin_s": 0.5, "from": 0.1, "to": 0.2, "settling_s": 0.3, "reason": ""}
    ],
    "events": [{"output": "angle", "time": 1.0, "what": "load", "peak": 0.1, "left": None}],
    "margins": {"Ms": 1.5},
}
BOX = [
    {
        "controller": "pid",
        "worst_score": 0.8,
        "requirements": [{"requirement": "rmse", "hard": True, "met": 3, "draws": 4}],
    }
]
VERDICT = {
    "schema": "workbench.verdict/1",
    "verdict": "named",
    "findings": [
        {"where": ["joint.torque"], "effect": "quadratic_drag", "class": ["quadratic_drag"]}
    ],
    "fit": {"held_out": {"extended": {"angle": 1e-5}, "refitted": {"angle": 1e-2},
                         "noise_floor": {"angle": 1e-5}}},
}  # fmt: skip
ANSWER = {"truth": [{"effect": "tilt"}], "salt": "3f"}
PLANT = {
    "plant": {
        "name": "servo_axis",
        "options": {},
        "effects": ["joint_hysteresis"],
        "without": [],
        "parameters": {"mass": 99.0},
    }
}
NAMES = b"""[groups]
arm = ["joint"]

[effects.tilt]
library = ["gravity"]
ports = ["joint.torque"]
sensor = false
"""
CONDITIONS = json.loads(
    shipped_study("arm").with_name("arm.baseline.json").read_text(encoding="utf-8")
)["conditions"]

SUBJECTS: dict[str, Subject] = {
    "CSV": Subject("a.csv", csv, of_text, recording),
    "CSV of a plant": Subject("a.csv", csv, of_text, of_a_plant),
    "CSV with decimal commas": Subject("a.csv", german, of_text, recording),
    "CSV of the workbench": Subject("a.csv", own, of_text, recording),
    "CSV, compressed": Subject("a.csv.gz", packed, of_bytes, recording),
    "MATLAB": Subject("a.mat", mat_5, of_bytes, recording),
    "MATLAB 7.3": Subject("a.mat", mat_73, of_bytes, recording),
    "Parquet": Subject("a.parquet", parquet, of_bytes, recording),
    "JSON log": Subject("a.json", log, of_text, recording),
    "JSON log, entries": Subject("a.json", log, damaged_json, recording),
    "mapping": Subject("m.toml", fixed(MAPPING), damaged_toml, mapped),
    "case": Subject("case.toml", fixed(CASE), damaged_toml, case),
    "shipped case": Subject(
        "case.toml",
        lambda _: (shipped_folder() / "practice-07" / "case.toml").read_bytes(),
        damaged_toml,
        case,
    ),
    "force map": Subject(
        "map.csv",
        fixed(b"pressure_bar,length_mm,force_N\n1,190,100\n2,180,200\n3,170,250\n"),
        of_text,
        read_table,
    ),
    "recorded reference": Subject(
        "r.csv", csv, of_text, lambda path: Recorded.read(path, "angle_deg", unit="deg")
    ),
    "study": Subject("study.toml", fixed(STUDY.encode()), damaged_toml, load_study),
    "baseline": Subject(
        "b.json",
        fixed({"kind": "workbench baseline", "schema": 2, "study": "s", "conditions": CONDITIONS,
               "runs": [RUN], "box": BOX}),
        damaged_json,
        baseline,
    ),
    "results": Subject(
        "results.json",
        fixed({"kind": "workbench results", "schema": 1, "study": "s", "runs": [RUN],
               "conditions": CONDITIONS, "tolerances": {"rmse": {"relative": 0.1}},
               "robustness": BOX, "requirements": [{"hard": True, "met": False}]}),
        damaged_json,
        accepted,
    ),
    "verdict": Subject(
        "one.json", fixed(VERDICT), damaged_json, lambda p: read_answer(p, "one", read_names())
    ),
    "plant of a verdict": Subject(
        "verdict.json",
        fixed(PLANT),
        damaged_json,
        lambda path: PLANTS.get(str(path)).model({})
    ),
    "plant of MATLAB": Subject(
        "plant.mat", matlab_plant, of_bytes, lambda path: PLANTS.get(str(path)).model({})
    ),
    "key": Subject("key.json", fixed({"one": ANSWER}), damaged_json, key),
    "names of a key": Subject("names.toml", fixed(NAMES), damaged_toml, read_names),
    "commitments": Subject(
        "c.txt",
        fixed(f"one {commitments(ANSWER)[0]}\n".encode()),
        of_text,
        lambda path: check_commitments({"one": ANSWER}, path),
    ),
    "kept run": Subject(
        "0.json",
        fixed({**RUN, "inputs": {"files": {}, "packages": {}}}),
        damaged_json,
        kept_run,
        sure=True,
    ),
}  # fmt: skip
