"""Files that users keep: what is no such file is one sentence; what is, is compared in its unit."""

from __future__ import annotations

import copy
import json
from functools import partial
from pathlib import Path

import pytest

from tests.fuzz.subjects import RUN, SUBJECTS
from workbench.errors import WorkbenchError
from workbench.study.baseline import changes, read_baseline
from workbench.verification.metrics import tolerance_of

KINDS = ("baseline", "results", "verdict", "key", "plant of a verdict")


@pytest.mark.parametrize("text", ["", "[" * 5000, "\x00", "null", "[]", "3", '{"a": NaN}', "<<<<"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_such_file_is_a_sentence(kind: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / SUBJECTS[kind].name
    path.write_text(text)
    with pytest.raises(WorkbenchError):
        SUBJECTS[kind].read(path)
    path.write_bytes(b"\xff\xfe{}")
    with pytest.raises(WorkbenchError, match=r"is no JSON|UTF-8"):
        SUBJECTS[kind].read(path)


def test_a_run_that_stands_twice_is_refused(tmp_path: Path) -> None:
    table = {"schema": 2, "study": "s", "conditions": {}, "runs": [RUN, RUN]}
    (tmp_path / "b.json").write_text(json.dumps(table))
    with pytest.raises(WorkbenchError, match="has the run pid, nominal, step, 1 twice"):
        read_baseline(tmp_path / "b.json")


def test_a_number_of_another_unit_is_no_number_to_compare_with(tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    rules = partial(changes, {n: tolerance_of(n) for n in ("rmse", "settling_time")})
    for unit, ways in (("rad", []), ("mrad", ["worse"]), ("bar", ["worse"])):
        run = copy.deepcopy(RUN)
        run["metrics"]["rmse"] |= {"unit": unit, "display_unit": unit}  # type: ignore[index]
        path.write_text(json.dumps({"schema": 2, "study": "s", "conditions": {}, "runs": [run]}))
        stored = read_baseline(path)
        path.write_text(json.dumps({"schema": 2, "study": "s", "conditions": {}, "runs": [RUN]}))
        now = read_baseline(path).records.values()
        assert [c.way for c in rules(now, stored)] == ways
