"""Set-up shared by every test and doctest."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Each worker stays on one core: nested threads only compete with the other workers. NumPy counts
# them when it is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402
import pytest  # noqa: E402

from tests.once import SHARED  # noqa: E402
from tests.shell import Refused, Said, Shell  # noqa: E402

# Pictures are drawn without a display, also by the doctests and the notebooks' kernels.
os.environ["MPLBACKEND"] = "Agg"


def pytest_configure(config: pytest.Config) -> None:
    """Make the folder of shared results; workers find it in their environment."""
    if SHARED not in os.environ:
        os.environ[SHARED] = tempfile.mkdtemp(prefix="workbench-tests-")
        config.add_cleanup(lambda: shutil.rmtree(os.environ.pop(SHARED)))


@pytest.fixture(autouse=True)
def _own_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where one test has modules of a user, the next one looks for none."""
    monkeypatch.setattr(sys, "path", [*sys.path])


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in every run."""
    return np.random.default_rng(20260101)


@pytest.fixture
def forgotten() -> Iterator[None]:
    """Which compiler there is, and what it has built, is found anew before and after."""
    from controllers.quadratic_program.solver import quadratic_program, solver_library
    from workbench.computing.machine_code import compiler

    def forget() -> None:
        for cache in (compiler, solver_library, quadratic_program):
            cache.cache_clear()

    forget()
    yield
    forget()


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without their pictures, which take long and are drawn by other tests."""
    monkeypatch.setattr("workbench.reports.page.inline_svg", lambda picture: "")
    monkeypatch.setattr("workbench.reports.page.save", lambda picture, folder: None)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str]) -> Shell:
    """The command line, in this process."""
    from workbench.cli.main import run

    def typed(*words: str | Path, status: int | None = 0) -> Said:
        parts = ([str(w)] if isinstance(w, Path) else shlex.split(w) for w in words)
        left = run([part for some in parts for part in some])
        said = Said(*capsys.readouterr())
        assert status in (left, None), said.err
        return said

    return typed


@pytest.fixture
def refused(shell: Shell) -> Refused:
    """A mistake on the command line: its last line is a sentence, and its status 2."""
    from workbench.cli.main import WRONG_USE

    def typed(*words: str | Path) -> str:
        said = shell(*words, status=WRONG_USE).err
        assert said.splitlines()[-1].startswith("workbench: ") and "Traceback" not in said
        return said

    return typed


@pytest.fixture(scope="session")
def external_folder() -> Path:
    """The user's data folder; the test is skipped when none is named."""
    named = os.environ.get("WORKBENCH_DATA", "")
    if not named or not Path(named).is_dir():
        pytest.skip("WORKBENCH_DATA names no folder with recordings of real machines")
    return Path(named)
