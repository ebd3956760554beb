"""`import workbench` stays light: what is slow to import is imported where it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = (
    "control", "matplotlib", "scipy", "scipy.optimize", "scipy.signal", "scipy.sparse",
    "scipy.stats", "pandas", "h5py", "pyarrow", "statsmodels", "IPython",
)  # fmt: skip


def loaded_by(statement: str) -> set[str]:
    """Return which of the heavy packages a fresh interpreter has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint(*(set(sys.modules) & set({HEAVY!r})))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


@pytest.mark.parametrize("package", ["workbench", "controllers"])
def test_import_loads_nothing_heavy(package: str) -> None:
    assert loaded_by(f"import {package}") == set()


def test_a_plant_loads_nothing_heavy() -> None:
    assert loaded_by("import workbench as wb; wb.arm()") == set()


def test_a_heavy_import_is_found() -> None:
    assert "scipy" in loaded_by("import scipy.linalg")


def test_what_runs_designs_and_shows_them_loads_nothing_heavy() -> None:
    figures = "from workbench.reports.figure import figures_of; figures_of('study')"
    assert loaded_by(f"import workbench.study.result; {figures}") <= {"scipy"}


def test_a_refit_needs_neither_filters_nor_statistics_of_scipy() -> None:
    asked = (
        "import numpy as np",
        "from workbench.diagnosis.estimation.simulated_recordings import gauss_markov",
        "from workbench.diagnosis.estimation.noise_colour import follows",
        "from workbench.recordings.resampling import low_pass",
        "error = low_pass(gauss_markov(200, 1.0, 0.1, 0.01, np.random.default_rng(1)), 0.2)",
        "follows([error], [np.eye(200)[:, :1]])",
    )
    assert not {"scipy.signal", "scipy.stats"} & loaded_by("\n".join(asked))


def test_a_design_of_the_arm_loads_no_python_control() -> None:
    design = "from controllers.joint.observer import kalman_correction; kalman_correction()"
    assert not {"control", "matplotlib"} & loaded_by(design)
