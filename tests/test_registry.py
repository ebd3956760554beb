"""The registry: built-in, installed and own members."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest

from workbench.errors import WorkbenchError
from workbench.registry import Registry, load_object


def _write(folder: Path, name: str, text: str) -> None:
    (folder / f"{name}.py").write_text(text)


def test_members_are_the_objects_of_a_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "numbers_of_mine").mkdir()
    for name, text in (
        ("__init__", ""),
        ("a", "from types import SimpleNamespace\none = SimpleNamespace(name='number-one')\n"),
        ("b", "from numbers_of_mine.a import one\nother = 3\n"),
    ):
        _write(tmp_path / "numbers_of_mine", name, text)
    monkeypatch.syspath_prepend(tmp_path)
    registry = Registry("number", SimpleNamespace, package="numbers_of_mine", group="tests.nothing")
    assert registry.names() == ("number-one",)
    assert registry.get("number_one").name == "number-one"
    with pytest.raises(WorkbenchError, match=r"'number-two'.*number-one.*module:object"):
        registry.get("number-two")
    with pytest.raises(WorkbenchError, match=r"is a float; it must be a SimpleNamespace"):
        registry.get("math:pi")


def test_a_function_that_a_package_announces_has_the_name_of_its_entry_point(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    entry = SimpleNamespace(name="rolling-mill", value="acme.plants:mill", load=lambda: dict)
    monkeypatch.setattr("workbench.registry.entry_points", lambda group: [entry])
    registry = Registry(
        "plant",
        SimpleNamespace,
        package="workbench.errors",
        group="example.plants",
        adopt=lambda found, name: SimpleNamespace(name=name, found=found),
    )
    assert registry.get("rolling_mill").found is dict


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("def broken(:\n", r"SyntaxError.*line 1"),
        ("import math\nmath.nothing\n", r"AttributeError.*line 2"),
        ("import sys\nsys.exit(0)\n", r"left the process with 0.*line 2"),
        ("import nowhere_at_all\n", r"No module named 'nowhere_at_all'"),
    ],
)
def test_a_mistake_in_a_users_module_is_a_sentence(tmp_path: Path, text: str, told: str) -> None:
    name = f"own_{abs(hash(text))}"
    _write(tmp_path, name, text)
    with pytest.raises(WorkbenchError, match=told):
        load_object("design", f"{name}:best", folder=tmp_path)


@pytest.mark.parametrize("name", ["nowhere", "nowhere.py"])
def test_a_module_that_is_not_there_is_told_with_the_folder(tmp_path: Path, name: str) -> None:
    _write(tmp_path, "nowhere_else", "best = 1\n")
    with pytest.raises(WorkbenchError, match=rf"no module 'nowhere' in {tmp_path}.*mine\.py"):
        load_object("design", f"{name}:best", folder=tmp_path)


def test_modules_of_the_same_name_in_two_folders_are_told_apart(tmp_path: Path) -> None:
    for folder, value in (("a", 1.0), ("b", 2.0)):
        (tmp_path / folder).mkdir()
        _write(tmp_path / folder, "my_own_numbers", f"value = {value}\n")
    found = [
        load_object("number", "my_own_numbers:value", folder=tmp_path / f) for f in ("a", "b", "a")
    ]
    assert found == [1.0, 2.0, 1.0]


def test_a_file_stands_for_its_module(tmp_path: Path) -> None:
    (tmp_path / "rigs").mkdir()
    _write(tmp_path / "rigs", "my_own_rig", "import math\nfrom pathlib import Path\nlength = 3.0\n")
    for file in ("rigs/my_own_rig.py", str(tmp_path / "rigs" / "my_own_rig.py")):
        assert load_object("number", f"{file}:length", folder=tmp_path) == 3.0
    with pytest.raises(WorkbenchError, match=r"must be one of length; did you mean 'length'"):
        load_object("number", "rigs/my_own_rig.py:lenght", folder=tmp_path)


def test_what_is_no_reference_is_refused() -> None:
    for bad in ("math", ":pi", "math:", "not a module:x"):
        with pytest.raises(WorkbenchError, match="module:object"):
            load_object("number", bad)
    assert load_object("number", "math:pi") == math.pi


def test_what_one_package_breaks_stops_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    def crash() -> None:
        raise ImportError("libmill.so")

    good = SimpleNamespace(name="mill")
    entries = [
        SimpleNamespace(name="crash", value="bad:x", load=crash, dist=SimpleNamespace(name="acme")),
        SimpleNamespace(name="mill", value="mills:mill", load=lambda: good),
        SimpleNamespace(
            name="again", value="others:mill", load=lambda: SimpleNamespace(name="mill")
        ),
    ]
    monkeypatch.setattr("workbench.registry.entry_points", lambda group: entries)
    registry = Registry(
        "plant", SimpleNamespace, package="workbench.errors", group="example.plants"
    )
    with pytest.warns(UserWarning, match="left out") as told:
        assert registry.get("mill") is good
    assert "'crash' of acme failed: ImportError: libmill.so" in str(told[0].message)
    assert "has the name of another plant" in str(told[1].message)
    assert registry.names() == ("mill",)
    with pytest.raises(WorkbenchError, match="of acme failed"):
        registry.get("crash")


def test_what_a_function_imports_when_it_is_called_stands_beside_it(tmp_path: Path) -> None:
    _write(tmp_path, "my_own_helper", "value = 3.0\n")
    _write(
        tmp_path,
        "my_own_designs",
        "def best():\n    import my_own_helper\n    return my_own_helper.value\n",
    )
    best = load_object("design", "my_own_designs:best", folder=tmp_path)
    assert best() == 3.0
