"""Studies that ship with the package."""

from __future__ import annotations

from pathlib import Path

from workbench.data_folder import shipped_folder
from workbench.errors import check_choice


def shipped_study(name: str) -> Path:
    """Return the file of a shipped study; its baseline is ``NAME.baseline.json`` beside it."""
    folder = shipped_folder() / "studies"
    check_choice("shipped study", name, sorted(path.stem for path in folder.glob("*.toml")))
    return folder / f"{name}.toml"
