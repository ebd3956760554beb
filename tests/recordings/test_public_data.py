"""Public data sets: a local folder first, else the publisher, checked."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pooch
import pytest

from workbench.errors import WorkbenchError
from workbench.recordings.public_data import fetch, public_data_sets, public_file, public_files

FILE = "emps/DATA_EMPS.mat"


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pooch, "os_cache", lambda name: tmp_path / "cache" / name)


class _Publisher:
    """Stands in for the network: sends some bytes, remembers what was asked."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.asked: list[str] = []

    def __call__(self, url: str, output_file: Any, *_: Any, **__: Any) -> None:
        self.asked.append(url)
        Path(output_file).write_bytes(self.content)


def _publish(monkeypatch: pytest.MonkeyPatch, content: bytes) -> _Publisher:
    publisher = _Publisher(content)
    monkeypatch.setattr("pooch.core.choose_downloader", lambda *_, **__: publisher)
    return publisher


def test_a_local_folder_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    publisher = _publish(monkeypatch, b"")
    for inner in ("real/emps", "emps"):
        place = tmp_path / inner.replace("/", "-") / inner
        place.mkdir(parents=True)
        (place / "DATA_EMPS.mat").write_bytes(b"mine")
        found = public_file(FILE, data=tmp_path / inner.replace("/", "-"))
        assert found.read_bytes() == b"mine"
    assert publisher.asked == []


def test_what_no_folder_holds_is_fetched_once_from_its_publisher(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    content = b"recorded"
    publisher = _publish(monkeypatch, content)
    from workbench.recordings import public_data

    registry = public_data._registry()
    monkeypatch.setitem(
        registry["emps"]["files"]["DATA_EMPS.mat"], "sha256", hashlib.sha256(content).hexdigest()
    )
    assert public_file(FILE).read_bytes() == content
    assert public_file(FILE).is_relative_to(tmp_path)
    assert public_file(FILE, data=tmp_path).read_bytes() == content
    assert len(publisher.asked) == 1
    assert publisher.asked[0].startswith("https://raw.githubusercontent.com/forgi86/")
    assert publisher.asked[0].endswith("/examples/EMPS/data/DATA_EMPS.mat")


def test_a_file_that_is_not_the_expected_one_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    _publish(monkeypatch, b"something else")
    with pytest.raises(WorkbenchError, match="not the file expected"):
        fetch("emps", "DATA_EMPS.mat")


def test_no_network_is_one_clear_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise ConnectionError("no route")

    monkeypatch.setattr("pooch.core.choose_downloader", lambda *_, **__: broken)
    with pytest.raises(WorkbenchError, match="could not be fetched .* --data"):
        fetch("emps", "DATA_EMPS.mat")


def test_unknown_names_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="public data set is 'emp'"):
        public_file("emp/DATA_EMPS.mat")
    with pytest.raises(WorkbenchError, match="it must be one of DATA_EMPS.mat"):
        public_file("emps/DATA.mat")


@pytest.mark.parametrize("data_set", public_data_sets())
def test_local_files_are_those_of_the_registry(data_set: str, external_folder: Path) -> None:
    from workbench.recordings import public_data

    for name in public_files(data_set):
        path = public_file(f"{data_set}/{name}", data=external_folder)
        known = public_data._registry()[data_set]["files"][name]["sha256"]
        assert hashlib.sha256(path.read_bytes()).hexdigest() == known, name
