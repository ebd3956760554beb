"""A bad study gets one sentence with file and line; a good one holds what was written."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.study.small_study import TEXT, small_study
from workbench.errors import WorkbenchError
from workbench.study.read import load_study
from workbench.study.study import Demand
from workbench.verification import Requirement


def line(part: str) -> int:
    """Return the line of the small study that holds a text."""
    return TEXT[: TEXT.index(part)].count("\n") + 1


BAD: dict[str, tuple[str, str, int, tuple[str, ...]]] = {
    # what is wrong: text, its replacement, line of the mistake after it, words of the sentence
    "unknown key": ('load = "3 kg"', 'lode = "3 kg"', 4, ("'lode'", "did you mean 'load'")),
    "unknown table": ("[plant]", "[plan]", 3, ("'plan'", "did you mean 'plant'")),
    "unknown unit": ('load = "4 kg"', 'load = "4 kgs"', 7, ("'kgs'", "did you mean 'kg s'")),
    "wrong unit": ('load = "3 kg"', 'load = "3 bar"', 4, ("'bar'", "does not measure it")),
    "value outside": ('load = "3 kg"', 'load = "30 kg"', 4, ("30 kg", "0 to 8 kg")),
    "unknown parameter": ("{ load =", "{ lod =", 7, ("'lod'", "did you mean 'load'")),
    "unknown design": ('design = "pid"', 'design = "pdi"', 10, ("'pdi'", "did you mean 'pid'")),
    "no such function": ('design = "pid"', 'design = "nowhere:pid"', 10,
                         ("'nowhere'", "there is no module")),
    "unknown specification": ("bandwidth =", "bandwith =", 11, ("did you mean 'bandwidth'",)),
    "specification outside": ("= 30.0", "= 3000.0", 11, ("bandwidth is 3000",)),
    "unknown reference": ("references.angle", "references.angel", 17, ("did you mean 'angle'",)),
    "unknown kind": ('kind = "steps"', 'kind = "stairs"', 17, ("'stairs'", "sine")),
    "reference in another unit": ('unit = "deg"\ntimes', 'unit = "bar"\ntimes', 17,
                                  ("'bar'", "'rad'")),
    "times do not increase": ("times = [0.0, 0.1]", "times = [0.0, 0.0]", 17, ("must increase",)),
    "unknown metric": ('metric = "settling_time"', 'metric = "setling_time"', 24,
                       ("did you mean 'settling_time'",)),
    "negative limit": ("limit = 0.6", "limit = -0.6", 25, ("-0.6", "0 or more")),
    "unit of the limit": ('limit = 0.6\nunit = "s"', 'limit = 0.6\nunit = "deg"', 23,
                          ("'deg'", "'s'")),
    "impossible: below a sample": ("limit = 0.6", "limit = 0.001", 23, ("impossible", "0.002 s")),
    "impossible: never zero": ("limit = 0.6", "limit = 0", 23, ("impossible", "above zero")),
    "impossible: nothing solves": ('metric = "chatter"\nlimit = 1.0\nunit = "V/s"',
                                   'metric = "fallbacks"\nlimit = 0', 28,
                                   ("impossible", "solves an optimisation")),
    "impossible: contradiction": ('metric = "chatter"\nlimit = 1.0\nunit = "V/s"',
                                  'metric = "settling_time"\nkind = "at_least"\nlimit = 0.7', 28,
                                  ("impossible", "0.6", "0.7")),
    "impossible: no step": ('kind = "steps"\nunit = "deg"\ntimes = [0.0, 0.1]\nvalues = [25, 35]',
                            'kind = "sine"\nunit = "deg"\nmean = 30\namplitude = 5\n'
                            "frequency_Hz = 2", 24, ("impossible", "a step")),
    "unknown scenario": ('limit = 0.6', 'scenario = "stp"\nlimit = 0.6', 25,
                         ("'stp'", "did you mean 'step'")),
    "negative weight": ("limit = 0.6", "limit = 0.6\nweight = -1", 26, ("weight is -1",)),
    "requirement on nobody": ("limit = 0.6", 'limit = 0.6\ncontrollers = ["pd"]', 26,
                              ("did you mean 'pid'",)),
    "nominal twice": ('variations."4 kg"', "variations.nominal", 6, ("another name",)),
    "seeds": ('name = "small"', "seeds = [1, 1]", 1, ("different whole numbers",)),
    "schema": ('name = "small"', "schema = 7", 1, ("schema is 7",)),
    "no limit": ("limit = 0.6\n", "", 23, ("has no 'limit'",)),
    "requirement with another key": ("limit = 0.6", "limit = 0.6\nhrad = true", 26,
                                     ("did you mean 'hard'",)),
    "no duration": ('duration = "1.5 s"', "", 13, ("has no 'duration'",)),
    "change without a parameter": ('settle = "0.1 s"', "changes = [{ time = 1 }]", 15,
                                   ("has no 'parameter'",)),
    "change with another key": ('settle = "0.1 s"', "changes = [{ tme = 1 }]", 15,
                                ("did you mean 'time'",)),
    "fault without a kind": ('settle = "0.1 s"', 'faults = [{ time = 1, signal = "angle" }]', 15,
                             ("has no 'kind'",)),
    "no TOML": ("[plant]", "[plant", 3, ("line 3",)),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_mistake_is_told_with_its_line(name: str, tmp_path: Path) -> None:
    before, after, where, words = BAD[name]
    path = small_study(tmp_path, (before, after))
    with pytest.raises(WorkbenchError) as caught:
        load_study(path)
    text = str(caught.value)
    assert text.startswith(str(path)) and f"line {where}" in text, text
    assert "\n" not in text and all(word in text for word in words), text


MORE = {
    "box outside": ("[robustness.box]\nload = [2, 9]", 3, "9 kg"),
    "box upside down": ("[robustness.box]\nload = [4, 2]", 3, "must be lower"),
    "no box": ("[robustness]\ndraws = 10", 2, "has no 'box'"),
    "too few draws": ("[robustness]\ndraws = 1\n[robustness.box]\nload = [2, 4]", 3, "draws is 1"),
    "tolerance of nothing": ("[tolerances.rmsee]\nrelative = 0.1", 2, "did you mean 'rmse'"),
    "negative tolerance": ("[tolerances.rmse]\nrelative = -0.1", 3, "relative is -0.1"),
    "no such report": ("[report]\nphysical_limits = true", 3, "did you mean 'physical_limit'"),
    "neither true nor false": ('[report]\nphysical_limit = "yes"', 3, "must be true or false"),
    "report is no table": ("[[report]]", 2, "must be a table"),
    "angle out of reach": ('[linear]\nangles = ["30 deg", "80 deg"]', 3, "80"),
}


@pytest.mark.parametrize("name", MORE)
def test_a_mistake_in_an_optional_part(name: str, tmp_path: Path) -> None:
    added, where, word = MORE[name]
    path = small_study(tmp_path)
    path.write_text(f"{TEXT}\n{added}\n", encoding="utf-8")
    with pytest.raises(WorkbenchError) as caught:
        load_study(path)
    text = str(caught.value)
    assert f"line {TEXT.count(chr(10)) + where}:" in text and word in text, text


def test_a_change_and_a_disturbance(tmp_path: Path) -> None:
    rows = (
        'settle = "0.1 s"\n'
        'changes = [{ time = "0.5 s", parameter = "supply_pressure", value = "5 bar" }]\n'
        'disturbances = [{ time = 0.6, port = "joint.torque", level = "2 N m" }]'
    )
    study = load_study(small_study(tmp_path, ('settle = "0.1 s"', rows)))
    scenario = study.scenarios["step"]
    assert scenario.changes[0].value == 5e5 and scenario.disturbances[0].level == 2.0
    bad = rows.replace("joint.torque", "joint.torqe")
    with pytest.raises(WorkbenchError, match=r"line 17: port is 'joint.torqe'.*did you mean"):
        load_study(small_study(tmp_path, ('settle = "0.1 s"', bad)))


def test_what_was_written_is_what_is_run(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    assert list(study.variations) == ["nominal", "4 kg"]
    assert study.variations["4 kg"].plant.build().parameter("load").value == 4.0
    assert study.plant.build().parameter("load").value == 3.0
    assert study.controllers["pid"].at == (("angle", pytest.approx(math.radians(30.0))),)
    assert study.scenarios["step"].duration == 1.5
    assert [d.requirement.hard for d in study.demands] == [True, False]


def test_a_limit_without_a_unit_is_in_si(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path, ('limit = 0.6\nunit = "s"', "limit = 0.6")))
    assert str(study.demands[0]) == "settling_time at most 0.6 s"


def test_a_limit_may_carry_its_unit(tmp_path: Path) -> None:
    def told(limit: str) -> str:
        text = ('limit = 0.6\nunit = "s"', f"limit = {limit}")
        return str(load_study(small_study(tmp_path, text)).demands[0])

    assert told('"600 ms"') == "settling_time at most 600 ms"
    assert told('"0.6"') == told("0.6") == told('"0.6 s"') == "settling_time at most 0.6 s"
    with pytest.raises(WorkbenchError, match="'0.6 V' has the unit 'V', which does not measure it"):
        told('"0.6 V"')


def test_effects_of_the_library(tmp_path: Path) -> None:
    varied = (
        '[variations."4 kg"]\nparameters = { load = "4 kg" }',
        '[variations.sticky]\neffects = ["muscle_hysteresis"]\nnoise = 3\n'
        'parameters = { "muscle_hysteresis.level" = "10 N" }',
    )
    plant = load_study(small_study(tmp_path, varied)).variations["sticky"].plant.build()
    assert plant.parameter("muscle_hysteresis.level").value == 10.0
    noise = {q.name: q.noise_rms for q in plant.outputs}
    assert noise["pressure_1"] == pytest.approx(1800.0)
    wrong = (varied[0], varied[1].replace('["muscle_hysteresis"]', '["histeresis"]'))
    with pytest.raises(WorkbenchError, match="line 7: effect is 'histeresis'"):
        load_study(small_study(tmp_path, wrong))


def test_a_step_is_told_in_the_unit_of_its_output() -> None:
    required = Requirement("overshoot", 10.0, "%")
    told = [str(Demand(required, step=s, step_unit=u)) for s, u in ((0.2, "m"), (math.pi, "deg"))]
    assert told == [f"overshoot of steps of {size} at most 10 %" for size in ("0.2 m", "180°")]
