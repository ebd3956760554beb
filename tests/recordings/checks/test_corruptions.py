"""A good recording, corrupted: refused with the reason, corrected, doubted or left open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from workbench.data_folder import shipped_folder
from workbench.errors import WorkbenchError
from workbench.plants.arm import arm
from workbench.recordings import CheckReport, Recording, Signal, check_recording, read_recording
from workbench.recordings.column_matching import driven_by
from workbench.recordings.formats.delimited_text import read_text
from workbench.recordings.formats.format import ReadOptions
from workbench.recordings.recording import Vector

MODEL = arm(3.0)
HEAD = ("time_s", "valve_V", "angle_deg", "pressure_1_bar", "pressure_2_bar")
TIME, VALVE, ANGLE, PRESSURE = slice(0, 1), slice(1, 2), slice(2, 3), slice(3, 5)
Change = Callable[[Vector], Vector]


@pytest.fixture(scope="module")
def rows() -> Vector:
    """Eight seconds of a good recording, in the units of its header."""
    path = shipped_folder() / "practice-07" / "identify_closed.csv.gz"
    found = read_text(path, ReadOptions())
    assert tuple(found.headers) == HEAD
    return np.asarray(found.values[:4000])


def judged(
    folder: Path, rows: Vector, head: tuple[str, ...] = HEAD, *, known: bool = True
) -> CheckReport:
    """Write the rows to a file, and read and check it with the model of the arm or without."""
    path = folder / "r.csv"
    np.savetxt(path, rows, "%.10g", ",", header=",".join(head), comments="")
    model = MODEL if known else None
    wanted = driven_by(model) if model is not None else None
    seen = read_recording(path, signals=wanted)
    required = None if wanted is None else [w.name for w in wanted if w.name in seen]
    return check_recording(seen, model=model, required=required)


def of(columns: slice, change: Change) -> Change:
    """Return a change of some columns."""

    def changed(rows: Vector) -> Vector:
        out = rows.copy()
        out[:, columns] = change(rows[:, columns])
        return out

    return changed


def blocks(rows: Vector) -> Vector:
    """Exchange blocks of rows under a clock that goes on."""
    parts = np.split(rows, 10)
    out = np.vstack([parts[i] for i in (0, 5, 2, 8, 4, 1, 6, 7, 3, 9)])
    out[:, 0] = rows[:, 0]
    return out


def shuffled(rows: Vector) -> Vector:
    """Shuffle rows."""
    return np.random.default_rng(0).permutation(rows)


CORRUPTIONS: dict[str, tuple[Change, tuple[str, ...], str, str]] = {
    # what is done, header, the result or "doubt", words of the reason
    "radians in a column of degrees": (of(ANGLE, np.deg2rad), HEAD, "doubt", "numbers in rad"),
    "radians, by the model": (of(ANGLE, np.deg2rad), HEAD, "doubt", "less than the model says"),
    "a tenth of the pressures": (of(PRESSURE, lambda p: p / 10), HEAD, "doubt",
                                 "times as much as the model says"),
    "degrees in a column of radians": (
        lambda r: r, (*HEAD[:2], "angle_rad", *HEAD[3:]), "unfit", "look like deg, not rad"),
    "kPa in a column of bar": (of(PRESSURE, lambda p: 100 * p), HEAD, "unfit", "look like kPa"),
    "Pa in a column of bar": (of(PRESSURE, lambda p: 1e5 * p), HEAD, "unfit", "look like Pa"),
    "bar in a column of Pa": (
        lambda r: r, (*HEAD[:3], "pressure_1_Pa", "pressure_2_Pa"), "unfit", "look like bar"),
    "mV in a column of V": (of(VALVE, lambda v: 1e3 * v), HEAD, "unfit", "look like mV"),
    "V in a column of mV": (
        lambda r: r, ("time_s", "valve_mV", *HEAD[2:]), "doubt", "numbers in V"),
    "a pressure with ten times its gain": (of(PRESSURE, lambda p: 10 * p), HEAD, "doubt",
                                           "outside the plausible -1 to 11 bar"),
    "a command beyond its range": (of(VALVE, lambda v: 10 * v), HEAD, "doubt", "outside"),
    "a command about zero": (of(VALVE, lambda v: v - 5), HEAD, "doubt", "outside"),
    "half a turn more": (of(ANGLE, lambda q: q + 180), HEAD, "doubt", "outside the plausible"),
    "a turned angle": (of(ANGLE, np.negative), HEAD, "unfit", "angle is probably reversed"),
    "a mirrored angle": (of(ANGLE, lambda q: 60 - q), HEAD, "unfit", "angle is probably reversed"),
    "exchanged pressures": (lambda r: r[:, [0, 1, 2, 4, 3]], HEAD, "unfit", "exchanged"),
    "shuffled rows": (shuffled, HEAD, "unfit", "time runs backwards"),
    "reversed rows": (lambda r: r[::-1], HEAD, "unfit", "time runs backwards"),
    "shuffled rows under a good clock": (
        lambda r: np.column_stack([r[:, 0], shuffled(r)[:, 1:]]), HEAD, "unfit", "its noise"),
    "exchanged blocks under a good clock": (blocks, HEAD, "doubt", "jump at once"),
    "a command half a second late": (
        of(VALVE, lambda v: np.vstack([np.repeat(v[:1], 250, 0), v[:-250]])), HEAD, "unfit",
        "before valve does"),
    "a time in ns": (of(TIME, lambda t: 1e9 * t), HEAD, "unfit", "unit of the time"),
    "a time in ms": (of(TIME, lambda t: 1e3 * t), HEAD, "unfit", "unit of the time"),
    "s in a column of ms": (lambda r: r, ("time_ms", *HEAD[1:]), "unfit", "unit of the time"),
    "ns since 1970": (of(TIME, lambda t: 1e9 * (1.7e9 + t)), HEAD, "corrected", "ns since 1970"),
    "a constant angle": (of(ANGLE, lambda q: 0 * q + 30), HEAD, "unfit", "disconnected"),
    "no measurement": (lambda r: r[:, :2], HEAD[:2], "unfit", "no measurement"),
}  # fmt: skip


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_it_does_not_pass(name: str, rows: Vector, tmp_path: Path) -> None:
    change, head, wanted, reason = CORRUPTIONS[name]
    report = judged(tmp_path, change(rows), head)
    told = {c.name: c.note for c in report.checks if (c.doubt if wanted == "doubt" else
                                                      c.result == wanted)}  # fmt: skip
    assert any(reason in note for note in told.values()), str(report)
    assert wanted == "doubt" or report.result == wanted
    if wanted == "doubt":
        # A diagnosis may name what it is: it is told in the first line, and not refused.
        first = str(report).splitlines()[0]
        assert report.fit and "doubtful: " in first and all(n in first for n in told)


def test_what_nobody_could_see_is_left_open(rows: Vector, tmp_path: Path) -> None:
    report = judged(tmp_path, rows + [0, 0, 0, 3.0, 3.0], known=False)
    gauge = report.check("gauge pressure")
    assert gauge.result == "not checked" and "cannot be told from absolute" in gauge.note
    assert {"units", "signs"} <= {c.name for c in report.checks if c.result == "not checked"}


def test_a_good_recording_passes_without_a_doubt(rows: Vector, tmp_path: Path) -> None:
    report = judged(tmp_path, rows)
    assert report.result == "pass" and not [c for c in report.checks if c.doubt], str(report)


def test_a_time_without_a_unit_is_doubted_unless_a_model_knows_it(
    rows: Vector, tmp_path: Path
) -> None:
    head = ("t", *HEAD[1:])
    found = judged(tmp_path, rows, head, known=False).check("time base")
    assert found.doubt and "taken as s" in found.note
    assert not judged(tmp_path, rows, head).check("time base").doubt


def test_instants_of_a_data_frame(rows: Vector, tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    ns = np.round(1e9 * rows[:, 0]).astype(np.int64)
    columns = {name: rows[:, i] for i, name in enumerate(HEAD) if i}
    kinds = {
        "time": pa.array(ns + 1_700_000_000_000_000_000),
        "time_ns": pa.array(ns),
        "stamp": pa.array(ns, pa.timestamp("ns")),
        "stamp_us": pa.array(ns // 1000, pa.timestamp("us", "UTC")),
        "since": pa.array(ns, pa.duration("ns")),
    }
    for name, instants in kinds.items():
        path = tmp_path / "r.parquet"
        title = "time" if name != "time_ns" else name
        pq.write_table(pa.table({title: instants, **columns}), path)
        report = check_recording(read_recording(path))
        assert report.fit, (name, str(report))
        assert report.recording.duration == pytest.approx(rows[-1, 0] - rows[0, 0], rel=1e-6)
        assert report.recording.sample_time == pytest.approx(0.002, rel=1e-3)


def test_two_columns_of_a_name_and_an_empty_one(rows: Vector, tmp_path: Path) -> None:
    with pytest.raises(WorkbenchError, match="2 columns are called .angle_deg., and angle may be"):
        judged(tmp_path, rows, (*HEAD[:3], "angle_deg", HEAD[4]))
    with pytest.raises(WorkbenchError, match="is empty"):
        judged(tmp_path, of(ANGLE, lambda q: np.nan * q)(rows))


def test_dry_friction_of_a_model_says_nothing_about_its_speed() -> None:
    from workbench.plants.registry import PLANTS

    # The slope of Coulomb friction at rest would make this pendulum answer within 1.5 ms.
    model = PLANTS.get("pendulum").model({})
    time = np.arange(1200) * 0.005
    swing = np.sin(2.0 * time)
    names = [q.name for q in (*model.inputs, *model.outputs)]
    noise = 1e-3 * np.random.default_rng(0).normal(size=(len(names), len(time)))
    seen = Recording("swing", time, tuple(
        Signal(q.name, q.scale * (swing + noise[i]), q.unit)
        for i, q in enumerate((*model.inputs, *model.outputs))
    ))  # fmt: skip
    assert check_recording(seen, model=model).check("time base").result == "pass"
