"""Answers kept in a folder, one JSON file per case, so that an interrupted run goes on."""

from __future__ import annotations

import json
import math
import subprocess
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.diagnosis.verdict import SCHEMA
from workbench.errors import WorkbenchError
from workbench.files import write_whole


def keep(path: Path, row: Mapping[str, Any]) -> dict[str, Any]:
    """Write an answer and return it as it will be read; numbers that are not finite become null."""
    text = json.dumps(_plain(row), indent=1)
    write_whole(path, text)
    return dict(json.loads(text))


def read_kept(out: Path) -> list[dict[str, Any]]:
    """Return the answers that a folder keeps, by the names of their cases.

    Raises:
        WorkbenchError: If the folder holds none.
    """
    rows = [json.loads(path.read_text()) for path in sorted(out.glob("*.json"))]
    rows = [row for row in rows if isinstance(row, dict) and "verdict" in row]
    if not rows:
        raise WorkbenchError(
            f"{out} holds no answers; run 'workbench evaluate own-cases' or 'foreign' first"
        )
    return rows


def silent(kind: str, error: Exception | None = None) -> dict[str, Any]:
    """Return a verdict that says nothing, of an answerer that failed."""
    verdict: dict[str, Any] = {"schema": SCHEMA, "verdict": kind}
    verdict |= {"findings": [], "fit": {"held_out": {}}}
    if error is None:
        return verdict
    way = " > ".join(frame.name for frame in traceback.extract_tb(error.__traceback__)[-5:])
    return verdict | {"failure": f"{type(error).__name__}: {error} (in {way})"}


def version() -> str:
    """Return the commit under test, with a mark if files of the product differ from it."""
    root = Path(__file__).parents[2]

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=root, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    commit = git("rev-parse", "--short", "HEAD")
    return commit + ("+" if git("status", "--porcelain", "--", "workbench") else "")


def _plain(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {str(k): _plain(v) for k, v in data.items()}
    if isinstance(data, (list, tuple)):
        return [_plain(v) for v in data]
    if isinstance(data, float):
        return float(data) if math.isfinite(data) else None
    return data
