"""What a newcomer leaves out is found in the recordings, or said in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from workbench.cli.main import WRONG_USE, run

PLANT = """
from workbench.model import Input, Model, Output, Parameter, State

def motor():
    def equations(m):
        return {"w": (m.p.kt * m.u.u - m.p.b * m.x.w) / m.p.J}, {
            "speed": m.x.w, "torque": m.p.kt * m.u.u}
    return Model("motor", equations,
        states=(State("w", "rad/s"),),
        inputs=(Input("u", "V"),),
        outputs=(Output("speed", "rad/s"), Output("torque", "N m")),
        parameters=(
            Parameter("kt", "N m/V", value=0.05, lower=0.0, upper=0.2, fitted=True),
            Parameter("b", "N m s/rad", value=0.002),
            Parameter("J", "kg m2", value=0.004)))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A plant without ports, noise or scales, and recordings whose columns have other names."""
    (tmp_path / "naive.py").write_text(PLANT)
    monkeypatch.chdir(tmp_path)
    for name, seed in (("a", 1), ("b", 2)):
        rng = np.random.default_rng(seed)
        drive = np.repeat(rng.uniform(-6.0, 6.0, 20), 30)
        speed = np.zeros(drive.size)
        for k in range(drive.size - 1):
            speed[k + 1] = speed[k] + 0.01 * (0.055 * drive[k] - 0.002 * speed[k]) / 0.004
        table = np.c_[10.0 * np.arange(drive.size), drive, 60 / (2 * np.pi) * speed]
        table[:, 2] += rng.normal(0.0, 1.0, drive.size)
        np.savetxt(
            f"{name}.csv", table, delimiter=",", header="Time [ms],Supply [V],n [rpm]", comments=""
        )
    return tmp_path


def test_columns_of_other_names_are_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["recording", "a.csv", "--plant", "naive:motor"]) == 0
    text = capsys.readouterr().out
    # A drive that is held between samples is no frozen measurement, and a sensor may be absent.
    assert "command" in text and "no measurement freezes" in text and "torque" not in text


def test_noise_and_disturbance_come_from_the_recordings(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["refit", "--plant", "naive:motor", "--fit", "a.csv", "--hold-out", "b.csv"]) == 0
    said = capsys.readouterr()
    # 1 rpm is 0.105 rad/s; the lowest quarter of the blocks lies below.
    assert "speed declares no noise_rms; 0.09" in said.err or "0.10" in said.err
    assert "a twentieth of its signal is taken: w.rate" in said.err
    row = next(line for line in said.out.splitlines() if line.split()[:1] == ["kt"])
    assert float(row.split()[1]) == pytest.approx(0.055, rel=0.02)


def test_a_plant_that_fits_nothing_is_judged_as_it_is(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "naive.py").write_text(PLANT.replace(", fitted=True", ""))
    assert run(["refit", "--plant", "naive:motor", "--fit", "a.csv", "--hold-out", "b.csv"]) == 0
    assert "no parameter of 'motor' is declared fitted=True" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "instead", "said"),
    [
        ('"N m s/rad"', '"Nms/rad"', "did you mean 'N m s'?"),
        (", lower=0.0, upper=0.2", "", "between which it surely lies"),
        ('Input("u", "V")', 'Input("u", "A")', "no column for signal 'u' (A)"),
    ],
)
def test_mistakes_say_what_to_write(
    folder: Path, capsys: pytest.CaptureFixture[str], written: str, instead: str, said: str
) -> None:
    (folder / "naive.py").write_text(PLANT.replace(written, instead))
    words = ["refit", "--plant", "naive:motor", "--fit", "a.csv", "--hold-out", "b.csv"]
    assert run(words) == WRONG_USE
    assert said in capsys.readouterr().err
