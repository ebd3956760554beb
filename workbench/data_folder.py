"""Where recordings are found: shipped with the package, or in a folder of the user's own."""

from __future__ import annotations

import os
from pathlib import Path

from workbench.errors import WorkbenchError, check_choice

ENVIRONMENT_VARIABLE = "WORKBENCH_DATA"
"""Names the user's data folder when no folder is given."""


def shipped_folder() -> Path:
    """Return the folder of shipped recordings: in an installed package, or at a checkout's root.

    Raises:
        WorkbenchError: If neither place exists, which means an incomplete installation.
    """
    package = Path(__file__).resolve().parent
    for folder in (package / "_data", package.parent / "data"):
        if folder.is_dir():
            return folder
    raise WorkbenchError(
        f"the shipped recordings are missing beside {package}; install the package again"
    )


def shipped_cases() -> tuple[str, ...]:
    """Return the names of the shipped cases, sorted.

    Raises:
        WorkbenchError: If the installation carries no recordings.
    """
    return tuple(sorted(path.parent.name for path in shipped_folder().glob("*/case.toml")))


def shipped_data(name: str) -> Path:
    """Return the folder of a shipped case, with ``case.toml`` and its recordings."""
    return shipped_folder() / check_choice("shipped case", name, shipped_cases())


def data_folder(given: str | os.PathLike[str] | None = None) -> Path:
    """Return the user's data folder: the one given, else that of ``WORKBENCH_DATA``."""
    if given is not None:
        origin, text = "data folder", os.fspath(given)
    else:
        origin = f"data folder named by {ENVIRONMENT_VARIABLE},"
        text = os.environ.get(ENVIRONMENT_VARIABLE, "")
    if not text.strip():
        raise WorkbenchError(
            "no data folder is named; give the option --data FOLDER or set the environment "
            f"variable {ENVIRONMENT_VARIABLE}"
        )
    folder = Path(text).expanduser().absolute()
    if not folder.exists():
        raise WorkbenchError(
            f"{origin} {text!r} does not exist; give the folder that holds the recordings"
        )
    if not folder.is_dir():
        raise WorkbenchError(f"{origin} {text!r} is a file; give the folder that holds it")
    if not os.access(folder, os.R_OK | os.X_OK):
        raise WorkbenchError(f"{origin} {text!r} cannot be read; change its permissions")
    return folder


def external_data(relative: str, given: str | os.PathLike[str] | None = None) -> Path:
    """Return a file or folder, by its path with forward slashes, inside the user's data folder."""
    folder = data_folder(given)
    path = folder / relative
    if not path.resolve().is_relative_to(folder.resolve()):
        raise WorkbenchError(f"{relative!r} leaves the data folder {str(folder)!r}")
    if not path.exists():
        raise WorkbenchError(
            f"the data folder {str(folder)!r} holds no {relative!r}; check that it is the folder "
            "that the recordings were put in"
        )
    return path
