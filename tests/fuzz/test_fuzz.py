"""Whatever happens to a file, it is read or there is one sentence, never a traceback.

A few seeds of each kind run every time; 10,000 damaged files run with `make test-long`, or with
``python -m pytest -m long tests/fuzz``.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.subjects import SUBJECTS
from workbench.errors import WorkbenchError

FEW = 25
MANY = 10_000 // len(SUBJECTS) + 1


def refused(kind: str, folder: Path, seeds: range) -> int:
    """Read damaged files and return how many were refused with a sentence."""
    subject, count = SUBJECTS[kind], 0
    content = subject.make(folder)
    inner = folder / "damaged"
    inner.mkdir(exist_ok=True)
    path = inner / subject.name
    for seed in seeds:
        path.write_bytes(subject.damage(content, seed))
        try:
            subject.read(path)
        except WorkbenchError as error:
            assert not subject.sure, (kind, seed)
            assert 20 < len(str(error)) < 2000, (kind, seed, str(error))
            count += 1
        except Exception as error:
            raise AssertionError(f"{kind}, seed {seed}") from error
    return count


@pytest.mark.parametrize("kind", SUBJECTS)
def test_a_good_file_reads(kind: str, tmp_path: Path) -> None:
    path = tmp_path / SUBJECTS[kind].name
    path.write_bytes(SUBJECTS[kind].make(tmp_path))
    SUBJECTS[kind].read(path)


@pytest.mark.parametrize("kind", SUBJECTS)
def test_some_damaged_files(kind: str, tmp_path: Path) -> None:
    # The damage must bite, or the test shows nothing.
    assert refused(kind, tmp_path, range(FEW)) > 0 or SUBJECTS[kind].sure


@pytest.mark.long
@pytest.mark.parametrize("kind", SUBJECTS)
def test_ten_thousand_damaged_files(kind: str, tmp_path: Path) -> None:
    refused(kind, tmp_path, range(FEW, FEW + MANY))
