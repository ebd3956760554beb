"""One finished study that attempts to fool the gate share: runs that nothing changed are kept."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from tests.study.small_study import TEXT, changed
from workbench.files import write_whole
from workbench.study.baseline import baseline_text
from workbench.study.conditions import conditions
from workbench.study.read import load_study
from workbench.study.result import StudyResult, run_study

BOX = """
[robustness]
draws = 4
search = 0

[robustness.box]
load = [2, 6]
"""

SINE = """
[scenarios.sine]
duration = "1 s"
settle = "0.1 s"

[scenarios.sine.references.angle]
kind = "sine"
unit = "deg"
mean = 30
amplitude = 5
frequency_Hz = 1.0

[[requirements]]
metric = "rmse"
limit = 20.0
unit = "deg"
scenario = "sine"
"""

STUDY = TEXT + SINE + BOX


@dataclass(frozen=True)
class Gate:
    """A finished study and its baseline."""

    folder: Path

    @property
    def baseline(self) -> Path:
        """Return the baseline of the unchanged study."""
        return self.folder / "gate.baseline.json"

    @property
    def kept(self) -> Path:
        """Return the folder of its finished runs."""
        return self.folder / "kept"

    def compared(self, *changes: tuple[str, str], against: bool = True) -> StudyResult:
        """Return what comes of the changed study; only changed runs are done."""
        if self.kept.exists():
            shutil.copytree(self.kept, self.folder / "out" / "runs", dirs_exist_ok=True)
        path = self.folder / "gate.toml"
        path.write_text(changed(STUDY, *changes), encoding="utf-8")
        baseline = self.baseline if against else None
        return run_study(load_study(path), self.folder / "out", baseline=baseline)


def finished_gate(folder: Path) -> Gate:
    """Run the study and accept its results."""
    gate = Gate(folder)
    first = gate.compared(against=False)
    assert first.passed, first.headline()
    box = [r.table() for r in first.robustness]
    write_whole(
        gate.baseline, baseline_text(first.study.name, first.records, conditions(first.study), box)
    )
    shutil.copytree(folder / "out" / "runs", gate.kept)
    return gate
