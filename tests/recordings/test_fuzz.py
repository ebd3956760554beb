"""Whatever happens to a file, only a clear sentence may come out, or a recording."""

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.recordings.damage import damaged
from workbench.errors import WorkbenchError
from workbench.recordings import (
    check_recording,
    read_case,
    read_mapping,
    read_recording,
    write_recording,
)
from workbench.recordings.example import example_recording

SEEDS = range(60)
TRIAL = example_recording(seconds=2.0)[:250]


def csv(_: Path) -> bytes:
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
    return csv(folder).replace(b",", b";").replace(b".", b",")


def packed(folder: Path) -> bytes:
    return gzip.compress(csv(folder), mtime=0)


def own(folder: Path) -> bytes:
    return write_recording(TRIAL, folder / "own.csv").read_bytes()


def mat_5(folder: Path) -> bytes:
    from scipy.io import savemat

    savemat(folder / "a.mat", {"t": TRIAL.time, "u": TRIAL["valve"], "s": {"q": TRIAL["angle"]}})
    return (folder / "a.mat").read_bytes()


def mat_73(folder: Path) -> bytes:
    import h5py

    with h5py.File(folder / "b.mat", "w") as file:
        file["t"], file["u"] = TRIAL.time.reshape(1, -1), TRIAL["valve"].reshape(1, -1)
    return (folder / "b.mat").read_bytes()


def parquet(folder: Path) -> bytes:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    pq.write_table(pa.table({"t": TRIAL.time, "u": TRIAL["valve"]}), folder / "a.parquet")
    return (folder / "a.parquet").read_bytes()


def log(_: Path) -> bytes:
    entries = [
        {"t": t, "q": q, "on": True}
        for t, q in zip(TRIAL.time.tolist(), TRIAL["angle"].tolist(), strict=True)
    ]
    return json.dumps({"mass": 0.5, "entries": entries}).encode()


@pytest.mark.parametrize(
    ("name", "make", "text"),
    [
        ("a.csv", csv, True),
        ("a.csv", german, True),
        ("a.csv", own, True),
        ("a.csv.gz", packed, False),
        ("a.mat", mat_5, False),
        ("a.mat", mat_73, False),
        ("a.parquet", parquet, False),
        ("a.json", log, True),
    ],
)
def test_damaged_files(
    tmp_path: Path, name: str, make: Callable[[Path], bytes], text: bool
) -> None:
    content = make(tmp_path)
    path = tmp_path / "damaged" / name
    path.parent.mkdir()
    outcomes = set()
    for seed in SEEDS:
        path.write_bytes(damaged(content, seed, text=text))
        try:
            recording = read_recording(path)
            report = check_recording(recording)
            outcomes.add(report.result)
            if report.fit:
                # What passes or was corrected is whole: increasing time and no hole.
                assert report.recording.increasing
                assert np.isfinite(report.recording.matrix(report.recording.names)).all()
        except WorkbenchError as error:
            outcomes.add("error")
            assert 20 < len(str(error)) < 800, str(error)
    # The damage must bite, or the test shows nothing.
    assert outcomes & {"error", "unfit", "corrected"}


def test_damaged_settings(tmp_path: Path) -> None:
    mapping = b'columns = ["time_s", "u_V"]\n[signals.valve]\ncolumn = "u_V"\nsign = -1\n'
    settings = b'load_kg = 3\nplane = "horizontal"\nsupply_bar = 6.0\nsample_rate_Hz = 500\n'
    (tmp_path / "identify_open.csv").write_bytes(csv(tmp_path))
    for seed in SEEDS:
        (tmp_path / "case.toml").write_bytes(damaged(settings, seed, text=True))
        (tmp_path / "m.toml").write_bytes(damaged(mapping, seed, text=True))
        for read in (lambda: read_case(tmp_path), lambda: read_mapping(tmp_path / "m.toml")):
            try:
                read()
            except WorkbenchError as error:
                assert len(str(error)) > 20
