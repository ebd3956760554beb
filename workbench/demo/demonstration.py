"""Run the parts of the demonstration one after the other and write what they found."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from workbench.data_folder import ENVIRONMENT_VARIABLE, data_folder, external_data
from workbench.demo.part import Part
from workbench.errors import WorkbenchError
from workbench.files import json_text, whole_folder, write_whole
from workbench.reports.page import Commands, Page, Section, Words, write_page
from workbench.study.result import installed_version

PARTS: tuple[tuple[str, str, str], ...] = (
    ("open-loop experiment", "open_loop", "open_loop_part"),
    ("three controllers on the linear and the full model", "closed_loop", "closed_loop_part"),
    ("a recording, diagnosed", "diagnosed_case", "diagnosed_case_part"),
    ("linear models over the angles", "angle_map", "angle_map_part"),
    ("isometric identification experiment", "identification", "identification_part"),
    ("measured force maps against force laws", "force_maps", "force_maps_part"),
)
"""What is done, the module that does it and its function, in the order of the page."""

SCHEMA = 2
"""Version of the layout of ``results.json``."""


@dataclass(frozen=True)
class Demonstration:
    """What the demonstration wrote.

    Args:
        seconds: How long it took, in s.
    """

    page: Path
    seconds: float
    met: int
    missed: int
    failed: Mapping[str, str]
    interrupted: bool

    @property
    def complete(self) -> bool:
        """Whether every part ran and every requirement is met."""
        return not (self.failed or self.interrupted or self.missed)

    def __str__(self) -> str:
        lines = [f"could not be shown: {name}: {reason}" for name, reason in self.failed.items()]
        lines.append(f"{self.met} requirements met, {self.missed} missed; {self.seconds:.0f} s.")
        lines.append(f"Open {self.page} in a browser.")
        return "\n".join(lines)


def run_demo(
    out: str | os.PathLike[str],
    *,
    data: str | os.PathLike[str] | None = None,
    progress: Callable[[str], None] = lambda what: None,
    parts: tuple[tuple[str, str, str], ...] = PARTS,
) -> Demonstration:
    """Run the demonstration and write its page, pictures and numbers.

    A part that fails becomes a section that says why; the others are shown. Ctrl-C ends the run
    and keeps the parts that were finished.

    Args:
        out: Folder for ``report.html``, ``results.json`` and ``pictures/``; made if needed.
        data: Folder with recordings of real machines; by default that of the environment, if any.
    """
    folder = None
    if data is not None or os.environ.get(ENVIRONMENT_VARIABLE, "").strip():
        folder = data_folder(data)
    if data is not None:
        from workbench.demo.force_maps import FILE

        # Who names a folder wants what is in it; to find out at the end would waste minutes.
        external_data(FILE, folder)
    begin = time.perf_counter()
    done: dict[str, Part] = {}
    failed: dict[str, str] = {}
    durations: dict[str, float] = {}
    interrupted = False
    with whole_folder(out) as temporary:
        try:
            for title, module, function in parts:
                progress(title)
                started = time.perf_counter()
                done[module] = _run(module, function, folder, title, failed)
                durations[module] = round(time.perf_counter() - started, 2)
        except KeyboardInterrupt:
            interrupted = True
        if not interrupted:
            progress("page and pictures")
        page = _page(done, interrupted, out, data)
        write_page(page, temporary / "report.html", pictures=temporary / "pictures")
        seconds, marks = time.perf_counter() - begin, page.marks
        results = {
            "schema": SCHEMA,
            "requirements": marks,
            "failed": failed,
            "interrupted": interrupted,
            "duration_s": durations,
            **{name: part.results for name, part in done.items()},
        }
        write_whole(temporary / "results.json", json_text(results))
    return Demonstration(
        Path(out) / "report.html", seconds, marks["met"], marks["missed"], failed, interrupted
    )


def _run(
    module: str, function: str, folder: Path | None, title: str, failed: dict[str, str]
) -> Part:
    try:
        # Imported when its turn comes: each part needs libraries that take a while to load.
        part: Callable[..., Part] = getattr(import_module(f"workbench.demo.{module}"), function)
        found = part(folder) if module == "force_maps" else part()
    except WorkbenchError as error:
        failed[title] = str(error)
        reason = Words(f"This part could not be shown: {error}.", "note")
        return Part(Section(module.replace("_", "-"), title.capitalize(), (reason,)))
    # What a part has to show stands on the first screen; the rest is detail.
    return replace(found, section=replace(found.section, folded=True))


def _page(
    done: Mapping[str, Part],
    interrupted: bool,
    out: str | os.PathLike[str],
    data: str | os.PathLike[str] | None,
) -> Page:
    command = f"workbench demo --out {os.fspath(out)}"
    if data is not None:
        command += f" --data {os.fspath(data)}"
    sections = [part.section for part in done.values()]
    first = tuple(part.first for part in done.values() if part.first is not None)
    if interrupted:
        text = "The run was interrupted; only the parts that were finished are shown."
        sections.insert(0, Section("interrupted", "Interrupted", (Words(text, "note"),)))
    found = Words(
        "Every number stands in results.json beside this page, with its unit in its name; every "
        "picture stands in the folder pictures as PNG and SVG."
    )
    blocks = (found, Commands((command,)))
    sections.append(Section("reproduce", "Reproduce this page", blocks, folded=True))
    counted = Page("", "", tuple(sections)).marks
    return Page(
        "Antagonistic pneumatic-muscle arm",
        "",
        tuple(sections),
        facts=(
            ("requirements", f"{counted['met']} met, {counted['missed']} missed"),
            ("workbench", installed_version()),
        ),
        first=first,
        foot="Angles in degrees, pressures gauge, at 1.01325 bar ambient pressure unless said.",
    )
