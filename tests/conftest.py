"""Set-up shared by every test and doctest."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

# Pictures are drawn without a display, also by the doctests and the notebooks' kernels.
os.environ["MPLBACKEND"] = "Agg"
# Each worker stays on one core; nested threads only compete with the other workers.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in every run."""
    return np.random.default_rng(20260101)


@pytest.fixture(scope="session")
def external_folder() -> Path:
    """The user's data folder; the test is skipped when none is named."""
    named = os.environ.get("WORKBENCH_DATA", "")
    if not named or not Path(named).is_dir():
        pytest.skip("WORKBENCH_DATA names no folder with recordings of real machines")
    return Path(named)
