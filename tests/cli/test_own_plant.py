"""A plant, physics and a design of the user's own go through every verb, looked up by name."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from tests.shell import Refused, Shell
from workbench.cli.main import run

PLANTS = '''
from workbench.model import Input, Model, Output, Parameter, State

def circuit(*, inductance_mH=10.0, resistance_Ohm=5.0):
    """Series circuit of coil, resistor and capacitor."""
    def equations(m):
        loss = m.port("coil.voltage", m.p.R * m.x.current, unit="V",
                      signals={"current": m.x.current}, disturbance=0.01)
        rate = (m.u.source - loss - m.x.charge_voltage) / m.p.L
        return {"charge_voltage": m.x.current / m.p.C, "current": rate}, {
            "tapped": m.x.charge_voltage}
    return Model("circuit", equations,
        states=(State("charge_voltage", "V", 1.0), State("current", "A", 0.1)),
        inputs=(Input("source", "V", 1.0, lower=-10.0, upper=10.0),),
        outputs=(Output("tapped", "V", 1.0, noise_rms=1e-3),),
        parameters=(
            Parameter("R", "Ohm", value=resistance_Ohm, lower=0.5, upper=50.0, fitted=True),
            Parameter("L", "kg m2/(s2 A2)", value=1e-3 * inductance_mH, lower=1e-4, upper=1.0),
            Parameter("C", "s/Ohm", value=1e-3, lower=1e-5, upper=1e-1)))

MODEL = circuit()
'''

PHYSICS = """
from workbench.model import Effect, Parameter

def cubic_loss():
    size = Parameter("size", "V/A3", value=0.0, scale=1.0, lower=-100.0, upper=100.0, fitted=True)
    return Effect("cubic_loss", ("coil.voltage",),
                  lambda at: at.value + at.p.size * at.signals.current**3, parameters=(size,))
"""

DESIGNS = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Integral:
    gain: float
    sample_time: float = 0.002
    name: str = "integral"
    sensors: tuple = ("tapped",)
    controlled: tuple = ("tapped",)
    actuators: tuple = ("source",)
    preview: int = 0

    def initial_state(self, measurement):
        return measurement[0]

    def step(self, state, measurement, reference):
        state = state + self.gain * self.sample_time * (reference[0] - measurement[0])
        return (state,), state, {}

    def linear_command(self, command):
        return command

def integral(linear, specification):
    return Integral(specification.get("gain", 20.0))
"""

STUDY = """
name = "circuit"

[plant]
kind = "my_plants:circuit"
resistance = "6 Ohm"

[controllers.integral]
design = "my_designs:integral"
at = { tapped = "0 V" }

[scenarios.step]
duration = "0.6 s"

[scenarios.step.references.tapped]
kind = "steps"
unit = "V"
times = [0.0, 0.1]
values = [0.0, 1.0]

[[requirements]]
metric = "settling_time"
limit = 0.3
unit = "s"
"""

OWN = "--plant my_plants:circuit"


@pytest.fixture
def folder(here: Path) -> Path:
    """A folder of the user's own, which is the current one."""
    for name, text in (
        ("my_plants.py", PLANTS),
        ("my_physics.py", PHYSICS),
        ("my_designs.py", DESIGNS),
        ("circuit.toml", STUDY),
    ):
        (here / name).write_text(text)
    return here


def record(name: str, height: float, *more: str) -> Path:
    """Write a run of the circuit with noise of the sensor."""
    steps = f"--source 0:{height},0.1:-1,0.2:{0.5 * height},0.3:0.2"
    words = f"simulate {OWN} {steps} --duration 0.4s --sample-time 2ms --out {name}"
    assert run([*words.split(), *more]) == 0
    table = np.loadtxt(name, delimiter=",", skiprows=1)
    table[:, 2] += np.random.default_rng(round(10 * height)).normal(0.0, 1e-3, len(table))
    np.savetxt(name, table, delimiter=",", header="time_s,source_V,tapped_V", comments="")
    return Path(name)


def test_plants_says_what_it_takes(folder: Path, shell: Shell) -> None:
    text = shell("plants my_plants:circuit").out
    assert "Series circuit" in text and "number in mH, by default 10.0" in text
    text = shell("plants tanks").out
    assert " 0.15 V/s, 0.02 to 0.6, refitted\n" in text
    assert max(map(len, text.splitlines())) <= 100
    listed = shell("plants").out
    helped = " ".join(shell("linearise --help").out.split())
    for name in ("arm", "servo-axis", "pendulum"):
        assert name in listed and name in helped


def test_linearise_at_a_value_of_an_output(folder: Path, shell: Shell, refused: Refused) -> None:
    out = folder / "linear.json"
    shell("linearise", OWN, "--tapped 2000mV --resistance 6 --out linear.json")
    found = json.loads(out.read_text())
    assert found["inputs"] == pytest.approx({"source": 2.0})
    # s^2 + R/L s + 1/(L C)
    assert np.poly(np.array(found["A"])) == pytest.approx([1.0, 600.0, 1e5])
    # A model itself is a plant without options.
    shell("linearise --plant my_plants:MODEL --at tapped=1")
    refused("linearise --plant my_plants:MODEL --resistance 6")


def test_simulate_drives_any_input(folder: Path, shell: Shell) -> None:
    record("a.csv", 1.0)
    time, source, tapped = np.loadtxt("a.csv", delimiter=",", skiprows=1).T
    assert set(source) == {1.0, -1.0, 0.5, 0.2} and time[1] == 0.002
    damped, frequency = 250.0, math.sqrt(1e5 - 250.0**2)
    early = time[:40]
    wave = np.cos(frequency * early) + damped / frequency * np.sin(frequency * early)
    assert tapped[:40] == pytest.approx(1.0 - np.exp(-damped * early) * wave, abs=5e-3)
    # Pulses name the first input by themselves.
    shell("simulate", OWN, "--pulses 0.5V --period 20ms --duration 40ms")


def test_verify_runs_a_design_of_the_users_own(
    folder: Path, shell: Shell, refused: Refused
) -> None:
    words, step = f"verify {OWN}", "--from 0V --to 1V --hold 0.4s"
    own = (words, "-c my_designs:integral", step)
    assert "met" in shell(*own, "--require settling_time=0.3s").out
    shell(*own, "--require settling_time=10ms", status=1)
    # A design for the arm says what is missing; one for any linear model does it.
    assert "of the linear model" in refused(words, "-c pid")
    assert "plain-pid on circuit" in shell(words, "-c plain-pid", step).out


def test_plants_and_refits_are_told_in_the_units_of_their_author(here: Path, shell: Shell) -> None:
    (here / "clinic.py").write_text("""
from workbench.model import Input, Model, Output, Parameter, State

def drip():
    def equations(m):
        rate = m.u.drip / m.p.volume - m.p.loss * m.x.sugar
        return {"sugar": rate}, {"sugar": m.x.sugar}
    return Model(
        "drip", equations, time="min",
        states=[State("sugar", "mg/dl", 100.0, initial=90.0)],
        inputs=[Input("drip", "mg/min", 50.0, lower=0.0, upper=500.0)],
        outputs=[Output("sugar", "mg/dl", noise_rms=1.0)],
        parameters=[
            Parameter("volume", "dl", value=120.0),
            Parameter("loss", "1/min", value=0.02, lower=0.005, upper=0.1, fitted=True),
        ],
    )
""")
    told = shell("plants clinic:drip").out
    assert "inputs: drip (mg/min)" in told and "states: sugar (mg/dl)" in told
    assert re.search(r"loss +0\.02 1/min, 0\.005 to 0\.1, refitted", told)
    assert re.search(r"volume +120 dl$", told, re.MULTILINE)
    minutes = np.arange(0.0, 600.0, 2.0)
    drip = np.where(minutes % 200.0 < 100.0, 400.0, 50.0)
    sugar = [90.0]
    for given in drip[:-1]:
        end = given / 120.0 / 0.03
        sugar.append(end + (sugar[-1] - end) * np.exp(-0.03 * 2.0))
    read = sugar + np.random.default_rng(1).normal(size=len(drip))
    head = "time [min],sugar [mg/dl],drip [mg/min]"
    for name, part in (("a.csv", slice(200)), ("b.csv", slice(200, None))):
        table = np.column_stack([minutes, read, drip])[part]
        np.savetxt(name, table, delimiter=",", header=head, comments="")
    found = shell("refit --plant clinic:drip --fit a.csv --hold-out b.csv --out page").out
    value = re.search(r"loss +(\S+) \+- \S+ +1/min +prior 0\.02 ", found)
    assert value is not None and float(value[1]) == pytest.approx(0.03, rel=0.02)
    page = (here / "page" / "report.html").read_text()
    assert f"{float(value[1]):.5g}" in page and "1/min" in page


@pytest.mark.system
@pytest.mark.long
def test_refit_and_diagnose(folder: Path, shell: Shell) -> None:
    hidden = ["--effect", "my_physics:cubic_loss", "-p", "cubic_loss.size=60"]
    for i, height in enumerate((3.0, 5.0, 4.0)):
        record(f"r{i}.csv", height, *hidden)
    files = "--fit r0.csv --fit r1.csv --hold-out r2.csv"
    shell("refit", OWN, files, "--noise tapped=2mV --out refit")
    found = json.loads((folder / "refit" / "results.json").read_text())
    # The cube of the current is taken for more resistance.
    assert found["parameters"]["R"]["value"] > 5.0
    assert "--plant my_plants:circuit" in (folder / "refit" / "report.html").read_text()
    own = "--effects my_physics:cubic_loss --jobs 1"
    shell("diagnose", OWN, own, files, "--out diagnosis")
    verdict = json.loads((folder / "diagnosis" / "verdict.json").read_text())
    assert verdict["verdict"].startswith("named"), verdict["sentence"]
    named = {f["effect"] for f in verdict["findings"]} | {
        name for f in verdict["findings"] for name in f["class"]
    }
    assert "cubic_loss" in named


def test_a_case_names_its_plant_and_prepares_its_recordings(folder: Path) -> None:
    from workbench.recordings import read_case

    record("a.csv", 1.0)
    record("b.csv", 2.0)
    (folder / "case.toml").write_text(
        'plant = "my_plants:circuit"\n[options]\nresistance = "6 Ohm"\n[refit]\nstarts = 2\n'
        'noise = {tapped = "2 mV"}\n'
        '[[recordings]]\nfiles = "a.csv"\nuse = "fit"\nresample_Hz = 250\n'
        'derivatives = {slope = {of = "tapped", samples = 5}}\n'
        '[[recordings]]\nfiles = "b.csv"\nuse = "hold_out"\nrows = [0, 100]\n'
        "constants = {gain = 3.0}\n"
    )
    case = read_case(folder)
    assert case.model().parameter("R").value == 6.0
    assert case.refit.starts == 2 and case.refit.noise == {"tapped": 2e-3}
    assert len(case.fit["a"]) == 100 and case.fit["a"].signal("slope").unit == "V/s"
    assert len(case.hold_out["b"]) == 100 and set(case.hold_out["b"]["gain"]) == {3.0}


@pytest.mark.usefixtures("undrawn")
def test_report_shows_the_linear_loop(folder: Path, shell: Shell) -> None:
    shell("report circuit.toml --bode --tapped 1V --out margins")
    assert "integral" in (folder / "margins" / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (f"simulate {OWN} --source 0:1,0", "write it as TIME:VALUE"),
        (f"simulate {OWN} --source 0:12V", "source is 12 V; the valid range is -10 to 10"),
        (f"simulate {OWN} --resistence 3", "did you mean --resistance"),
        (f"simulate {OWN} --resistance 3V", "does not measure it"),
        (f"linearise {OWN} --effect my_physics:nothing", "nothing"),
        (f"linearise {OWN} --effect my_plants:circuit", "it must be an Effect"),
        ("linearise --plant my_plants:NAMES", "NAMES"),
        ("linearise --plant no_plants:rig", "no_plants"),
        (f"linearise {OWN} --at tapd=1", "did you mean 'tapped'"),
        (f"linearise {OWN} --option resistance", "write it as NAME=VALUE"),
        (f"refit {OWN}", "nothing to work on"),
        (f"refit {OWN} --fit a.csv --hold-out b.csv --noise x=1", "a.csv"),
    ],
)
def test_mistakes_are_one_sentence(
    arguments: str, message: str, folder: Path, refused: Refused
) -> None:
    said = refused(arguments)
    assert message in said and said.count("\n") == 1


def test_a_unit_that_one_output_alone_is_measured_in_tells_which_is_meant(
    here: Path, shell: Shell
) -> None:
    both = PLANTS.replace(
        '"tapped": m.x.charge_voltage}',
        '"tapped": m.x.charge_voltage, "filling": 0.2 * m.x.charge_voltage}',
    ).replace("noise_rms=1e-3),)", 'noise_rms=1e-3), Output("filling", "1", display_unit="%"))')
    (here / "my_plants.py").write_text(both)
    told = shell("verify --plant my_plants:circuit -c plain-pid --from 0% --to 4% --json").result
    assert [run["scenario"] for run in told["runs"]] == ["step 0 to 4 % and back"]
    held = shell("simulate --plant my_plants:circuit --source 2V --duration 20ms --out held.csv")
    assert "circuit" in held.out
    rows = np.genfromtxt("held.csv", delimiter=",", names=True)
    assert np.all(rows["source_V"] == 2.0)
