"""A study that runs in a second, and the ways in which tests change it."""

from __future__ import annotations

from pathlib import Path

TEXT = """\
name = "small"

[plant]
load = "3 kg"

[variations."4 kg"]
parameters = { load = "4 kg" }

[controllers.pid]
design = "pid"
specification = { bandwidth = 30.0 }

[scenarios.step]
duration = "1.5 s"
settle = "0.1 s"

[scenarios.step.references.angle]
kind = "steps"
unit = "deg"
times = [0.0, 0.1]
values = [25, 35]

[[requirements]]
metric = "settling_time"
limit = 0.6
unit = "s"

[[requirements]]
metric = "chatter"
limit = 1.0
unit = "V/s"
hard = false
"""


def small_study(folder: Path, *changes: tuple[str, str], name: str = "small.toml") -> Path:
    """Write the study with parts of its text replaced, and return its path."""
    path = folder / name
    path.write_text(changed(TEXT, *changes), encoding="utf-8")
    return path


def changed(text: str, *changes: tuple[str, str]) -> str:
    """Return a text with parts of it replaced."""
    for before, after in changes:
        assert before in text, before
        text = text.replace(before, after)
    return text


BY_BANDWIDTH = 'design = "pid"\nspecification = { bandwidth = 30.0 }'
"""The design of the study."""

WORSE = ("bandwidth = 30.0", "bandwidth = 12.0")
"""A slower design: it settles too late."""
