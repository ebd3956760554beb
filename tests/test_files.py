"""Results are written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.errors import WorkbenchError
from workbench.files import check_folder, whole_folder, write_whole


def test_a_failed_block_leaves_the_earlier_result(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out) as folder:
        (folder / "page.html").write_text("first")
    with pytest.raises(RuntimeError), whole_folder(out) as folder:
        (folder / "page.html").write_text("second")
        raise RuntimeError
    assert (out / "page.html").read_text() == "first"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_failed_block_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "out") as folder:
        (folder / "page.html").write_text("half")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def test_files_of_the_user_stay(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "mine.png").write_text("mine")
    with whole_folder(tmp_path) as folder:
        (folder / "pictures").mkdir()
        (folder / "pictures" / "steps.png").write_text("new")
    names = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert names == {"mine.png", "steps.png"}


def test_a_target_that_is_a_file_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.write_text("precious")
    with pytest.raises(WorkbenchError, match="is a file"), whole_folder(target):
        pass
    assert target.read_text() == "precious"


def test_an_unwritable_place_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    begun = False
    refused = pytest.raises(WorkbenchError, match="cannot be written")
    with refused, whole_folder(tmp_path / "file" / "out"):
        begun = True
    assert not begun


def test_a_file_keeps_its_content_when_the_new_one_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "results.json"
    write_whole(target, "old")

    def full_disk(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(WorkbenchError, match="no space left"):
        write_whole(target, "new")
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_a_folder_is_checked_before_the_work(tmp_path: Path) -> None:
    assert check_folder(tmp_path / "new" / "out").is_dir()
    assert list((tmp_path / "new" / "out").iterdir()) == []
    (tmp_path / "file").write_text("mine")
    with pytest.raises(WorkbenchError, match=r"is a file; give the name of a folder"):
        check_folder(tmp_path / "file")
    with pytest.raises(WorkbenchError, match=r"folder '.*' cannot be written"):
        check_folder(tmp_path / "file" / "below")
