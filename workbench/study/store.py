"""Finished runs on disk, so that a study that was stopped goes on where it was."""

from __future__ import annotations

import hashlib
import json
import os
import re
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from workbench.checked_json import Shape, TableShape, anything, named, read_json, text, whole
from workbench.errors import WorkbenchError
from workbench.files import write_whole
from workbench.study.inputs import Seen, digest, installed, seen, versions
from workbench.work.counted import Work, add

_OWN = (".py", ".json", ".csv", ".npz", ".npy", ".mat", ".parquet", ".yaml", ".toml", ".txt")
"""Endings of files that a user's own code may read."""

_RESULTS = ("results.json", "baseline.json")
_KEPT = TableShape(
    {"inputs": TableShape({"files": named(text), "packages": named(text)}), "work": named(whole)}
)


class Store:
    """A folder with one file per finished run, named by what the run depends on.

    A run is found again only if plant, controller, scenario, seed and the code are the same.

    Args:
        base: Folder of the study; files below it are known by their path from there.
    """

    def __init__(self, folder: Path, code: str, base: Path | None = None) -> None:
        self.folder = folder
        self.code = code
        self.base = str((base or Path.cwd()).resolve())
        self.touched: set[str] = set()
        self._now: dict[str, str] = {}

    def key(self, task: Any) -> str:
        """Return the name under which a task's result is kept.

        Args:
            task: A frozen task, whose representation says all it depends on.
        """
        return hashlib.sha256(f"{self.code}\0{task!r}".encode()).hexdigest()[:32]

    def get(self, key: str, shape: Shape = anything) -> dict[str, Any] | None:
        """Return what was kept under a key, whose work now counts as done.

        None if there is nothing, only a damaged one, or something that it was made from has
        changed.
        """
        known = f"{key}.json" in self.touched
        self.touched.add(f"{key}.json")
        try:
            found = read_json(self.folder / f"{key}.json", "run", _KEPT)
            shape(found, ())
        except WorkbenchError:
            return None
        if not self._current(found["inputs"]):
            return None
        if not known:
            add(found["work"])
        return dict(found)

    def _current(self, inputs: dict[str, Any]) -> bool:
        for name, known in inputs["files"].items():
            path = str(Path(self.base) / name)
            if path not in self._now:
                self._now[path] = digest(path)
            if self._now[path] != known:
                return False
        return all(installed(name) == known for name, known in inputs["packages"].items())

    def put(
        self, key: str, table: dict[str, Any], read: Seen | None = None, work: Work | None = None
    ) -> None:
        """Keep a table.

        Args:
            read: What the process that made it has read, beside what this one has.
        """
        self.touched.add(f"{key}.json")
        kept = {**table, "inputs": self._inputs(read), "work": dict(work or {})}
        write_whole(self.folder / f"{key}.json", json.dumps(kept))

    def _inputs(self, read: Seen | None) -> dict[str, Any]:
        results = str(self.folder.resolve().parent) + os.sep
        files, packages = seen()
        if read is not None:
            files, packages = {**files, **read.files}, (*packages, *read.packages)
        below = self.base + os.sep
        named = {
            path.removeprefix(below): known
            for path, known in files.items()
            if not path.startswith(results) and not path.endswith(_RESULTS)
        }
        return {"files": named, "packages": versions(packages)}

    def prune(self) -> None:
        """Remove the files of runs that the finished study no longer has, and no other files."""
        for path in self.folder.glob("*.json"):
            if re.fullmatch(r"[0-9a-f]{32}", path.stem) and path.name not in self.touched:
                path.unlink(missing_ok=True)


def _own_files(folder: Path) -> list[Path]:
    """Return modules and data of a user's own: beside the study, and in packages below it.

    Results and baselines of studies are no input of a run.
    """
    packages = {p.parent for p in folder.rglob("*.py")} | {folder}
    found = (p for place in sorted(packages) for p in sorted(place.iterdir()) if p.is_file())
    return [p for p in found if p.suffix in _OWN and not p.name.endswith(_RESULTS)]


def code_digest(*own: str) -> str:
    """Return a digest of the code that the numbers of a study depend on.

    Args:
        own: Folders with plants and designs of one's own, whose modules count too.
    """
    digest = _digest_of_the_workbench().copy()
    for path in (path for folder in own for path in _own_files(Path(folder))):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _digest_of_the_workbench() -> hashlib._Hash:
    import casadi as ca
    import numpy as np

    package = Path(__file__).resolve().parents[1]
    versions = f"{ca.CasadiMeta.version()} {np.__version__} {version('scipy')}"
    digest = hashlib.sha256(versions.encode())
    for root in (package, package.parent / "controllers"):
        for path in sorted(root.rglob("*.py")):
            if not {"reports", "cli", "demo", "speed", "_data"} & set(path.relative_to(root).parts):
                digest.update(path.name.encode())
                digest.update(path.read_bytes())
    return digest
