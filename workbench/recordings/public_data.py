"""Public recordings of real machines: from a data folder, or fetched from their publishers."""

from __future__ import annotations

import os
import tomllib
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from workbench.data_folder import ENVIRONMENT_VARIABLE, data_folder
from workbench.errors import WorkbenchError, check_choice


@cache
def _registry() -> dict[str, Any]:
    text = files("workbench.recordings").joinpath("public_data.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def public_data_sets() -> tuple[str, ...]:
    """Return the names of the public data sets: folders under ``real`` in a data folder."""
    return tuple(_registry())


def public_files(data_set: str) -> tuple[str, ...]:
    """Return the names of the files of a public data set."""
    check_choice("public data set", data_set, public_data_sets())
    return tuple(_registry()[data_set]["files"])


def public_file(name: str, *, data: str | os.PathLike[str] | None = None) -> Path:
    """Return a file of a public data set: from a data folder if it holds it, else fetched.

    In a data folder the file is looked for as ``real/SET/FILE`` and ``SET/FILE``. Elsewhere it is
    fetched from its publisher once, checked against its SHA-256 and kept in the user's cache.

    Args:
        name: ``SET/FILE``, such as ``emps/DATA_EMPS.mat``.
        data: Data folder; None reads ``WORKBENCH_DATA``.
    """
    data_set, _, file = name.partition("/")
    check_choice(f"file of data set {data_set}", file, public_files(data_set))
    if data is not None or os.environ.get(ENVIRONMENT_VARIABLE, "").strip():
        folder = data_folder(data)
        for path in (folder / "real" / data_set / file, folder / data_set / file):
            if path.is_file():
                return path
    return fetch(data_set, file)


def fetch(data_set: str, file: str) -> Path:
    """Fetch a file of a public data set from its publisher, or return the copy kept before."""
    entry = _registry()[data_set]
    known = entry["files"][file]
    if not entry["address"]:
        raise WorkbenchError(
            f"{file} is not published as a file that can be fetched; name a folder that holds it"
            f" with --data or {ENVIRONMENT_VARIABLE} ({entry['cite']})"
        )
    import pooch  # type: ignore[import-untyped]

    try:
        path = pooch.retrieve(
            url=entry["address"] + known["path"],
            known_hash=f"sha256:{known['sha256']}",
            fname=file,
            path=Path(pooch.os_cache("workbench")) / data_set,
        )
    except ValueError:
        raise WorkbenchError(
            f"what {entry['address']} sends as {file} is not the file expected (its SHA-256"
            " differs); get it from the publisher by hand and name its folder with --data"
        ) from None
    except OSError as error:  # what a transport raises, and what requests derives from
        raise WorkbenchError(
            f"{file} could not be fetched from {entry['address']}: {error}; connect to the network,"
            f" or name a folder that holds it with --data or {ENVIRONMENT_VARIABLE}"
        ) from None
    return Path(path)
