"""A mistake in a user's own module is a sentence with file and line, or a failed run."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from itertools import count
from pathlib import Path

import pytest

from tests.shell import Refused
from tests.study.small_study import changed
from workbench.computing.processes import PAUSE, parallel
from workbench.errors import WorkbenchError
from workbench.registry import told
from workbench.study.read import load_study
from workbench.study.tasks import execute, tasks

STUDY = """
[controllers.mine]
design = "MODULE:design"

[scenarios.rest]
duration = "0.1 s"
settle = "0.02 s"

[scenarios.rest.references.angle]
kind = "steps"
unit = "deg"
times = [0.0]
values = [25]

[[requirements]]
metric = "rmse"
limit = 1.0
unit = "deg"
"""

GOOD = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Mine:
    sample_time: float = 0.002
    name: str = "mine"
    sensors: tuple = ("angle",)
    controlled: tuple = ("angle",)
    actuators: tuple = ("valve",)
    preview: int = 0

    def initial_state(self, measurement):
        return 0

    def step(self, state, measurement, reference):
        return (5.0,), state + 1, {}

    def linear_command(self, command):
        return command

def design(linear, specification):
    return Mine()
"""

BEFORE_RUNS = {
    "wrong syntax": ("def design(", "def ((", "SyntaxError", "def (("),
    "an unknown name": ("def design(", "nowhere\ndef design(", "NameError", "nowhere"),
    "an exception": ("def design(", "raise RuntimeError('no licence')\ndef design(",
        "RuntimeError: no licence", "no licence"),
    "leaving with status 0": ("def design(", "import sys\nsys.exit(0)\ndef design(",
        "it left the process with 0", "sys.exit"),
    "a package that is missing": ("from dataclasses", "import nowhere\nfrom dataclasses",
        "No module named 'nowhere'", "import nowhere"),
    "no such function": ("def design(", "def desing(", "did you mean 'desing'?", ""),
    "a number for a function": ("def design(", "design = 3\ndef other(", "is a int", ""),
}  # fmt: skip

IN_A_RUN = {
    "leaving with status 0 in the design": ("return Mine()", "raise SystemExit(0)",
        "it left the process with 0", "SystemExit"),
    "leaving with status 0 in a step": ("return (5.0,), state + 1, {}", "raise SystemExit(0)",
        "it left the process with 0", "SystemExit"),
    "an exception of the base class": ("return (5.0,), state + 1, {}", "raise BaseException(3)",
        "BaseException: 3", "raise B"),
    "an unknown name in a step": ("state + 1", "stat + 1", "NameError", "stat +"),
    "a design of one argument": ("design(linear, ", "design(", "TypeError", ""),
    "no preview": ("    preview: int = 0\n", "", "it has no preview", ""),
    "no step": ("def step(", "def steps(", "it has no step", ""),
    "no linear_command": ("def linear_command(", "def linear(", "it has no linear_command", ""),
    "no sample time": ("    sample_time: float = 0.002\n", "", "it has no sample_time", ""),
    "a sample time in words": ("float = 0.002", 'str = "2 ms"', "sample_time", ""),
    "one name as sensors": ('("angle",)', '"angle"', "give a tuple of names", ""),
    "an unknown sensor": ('("angle",)', '("angel",)', "did you mean 'angle'?", ""),
    "an unknown actuator": ('("valve",)', '("pump",)', "actuator is 'pump'", ""),
    "a class": ("return Mine()", "return Mine", "is the class Mine", ""),
    "nothing": ("return Mine()", "return None", "is no controller", ""),
    "a step that returns nothing": ("return (5.0,), state + 1, {}", "pass", "returned None", ""),
    "a step of two parts": (", {}", "", "it must return the command", ""),
    "a command that is no tuple": ("(5.0,)", "5.0", "it must return the command", ""),
    "a command of two": ("(5.0,)", "(5.0, 1.0)", "the command as 1 number(s)", ""),
    "no information": (", {}", ", None", "a mapping with information", ""),
}  # fmt: skip

_NUMBERS = count()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all, so that the plant is linearised once."""
    return tmp_path_factory.mktemp("own")


def line_of(marker: str, before: str, after: str) -> str:
    """Return how a message ends that names the line with a marker."""
    lines = GOOD.replace(before, after).splitlines()
    return f"line {[marker in line for line in lines].index(True) + 1})" if marker else ""


def own_study(folder: Path, before: str, after: str, *_: str) -> Path:
    """Write the study and the module with a mistake beside it."""
    module = f"own_mistake_{os.getpid()}_{next(_NUMBERS)}"
    (folder / f"{module}.py").write_text(changed(GOOD, (before, after)), encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(STUDY.replace("MODULE", module), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", BEFORE_RUNS)
def test_a_module_that_cannot_be_used_is_a_sentence(name: str, folder: Path) -> None:
    *change, what, marker = BEFORE_RUNS[name]
    with pytest.raises(WorkbenchError) as caught:
        load_study(own_study(folder, *change))
    said = str(caught.value)
    assert "study.toml, line 3: " in said and what in said
    assert said.endswith(line_of(marker, *change))


@pytest.mark.parametrize("name", IN_A_RUN)
def test_a_run_that_goes_wrong_is_a_failed_row(name: str, folder: Path) -> None:
    *change, what, marker = IN_A_RUN[name]
    record = execute(tasks(load_study(own_study(folder, *change)))[0])
    assert record.failed and what in record.reason, record.reason
    assert record.reason.endswith(line_of(marker, *change))


def test_leaving_with_status_0_is_not_green(folder: Path, tmp_path: Path, refused: Refused) -> None:
    study = own_study(folder, *BEFORE_RUNS["leaving with status 0"])
    said = refused("compare --jobs 1", study, "--out", tmp_path / "out")
    assert "which a module must not do" in said


@pytest.mark.parametrize(
    ("mistake", "what"),
    [
        ("an unknown name in a step", "NameError"),
        ("leaving with status 0 in a step", "which a module must not do"),
    ],
)
def test_other_verbs_say_it_too(mistake: str, what: str, here: Path, refused: Refused) -> None:
    own_study(here, *IN_A_RUN[mistake])
    (module,) = here.glob("own_mistake_*.py")
    said = refused(f"verify --controller {module.stem}:design --from 25deg --to 30deg")
    assert what in said.splitlines()[-1] and f"{module.name}, line " in said.splitlines()[-1]


def test_our_own_frames_are_not_named_where_the_users_are() -> None:
    try:
        parallel([(len, (3,))]).__next__()
    except TypeError as error:
        assert Path(__file__).name in told(error)


def test_a_process_that_ends_in_the_middle_is_a_sentence() -> None:
    with pytest.raises(WorkbenchError, match="ended in the middle"):
        list(parallel([(os._exit, (0,)), (len, ("a",))], jobs=2))


def test_children_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    child = (
        "import os, time\nfrom workbench.computing.processes import end_with\n"
        "end_with(os.getppid())\nprint(os.getpid(), flush=True)\ntime.sleep(60)\n"
    )
    parent = f"import subprocess, sys\nsubprocess.run([sys.executable, '-uc', {child!r}])\n"
    with subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        number = int(process.stdout.readline())
        process.kill()
    end = time.monotonic() + 20 * PAUSE
    while time.monotonic() < end and Path(f"/proc/{number}").exists():
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
        if state == "Z":
            return
        time.sleep(0.05)
    assert not Path(f"/proc/{number}").exists()
