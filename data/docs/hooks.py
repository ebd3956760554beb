"""Build steps of the documentation site: it takes texts in from where they live.

Every text has one place. A page takes a file of the repository in, or one of its sections, with a
line of its own: ``<!-- include README.md # Put it on the rig -->``, or several files by a pattern
such as ``data/blind/*/README.md``; pictures are linked from the repository's root,
``/data/pictures/NAME.png``. Notebooks and the reference are made into pages here, so that no list
of them stands anywhere.
"""

from __future__ import annotations

import base64
import json
import os
import posixpath
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "data/docs/pages"

INCLUDE = re.compile(r"^<!-- include (\S+)(?: # (.+?))? -->$", re.MULTILINE)
HEADING = re.compile(r"^(#+) (.+)$")
FENCE = re.compile(r"^```(\w+) ([\w.]+)$", re.MULTILINE)
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")

ROOTED = re.compile(r"(!)\[([^\]]*)\]\(/([^)#\s]+)()\)")


def taken_in(text: str, folder: str = "") -> str:
    """Put the files that a text includes in their places.

    Args:
        folder: Folder of the page below `PAGES`, from which its links are written.

    Raises:
        ValueError: If a file or a section of it does not exist.
    """

    def place(found: re.Match[str]) -> str:
        texts = []
        for name, own in included(found):
            # Where a fence names the file that it shows, the site shows the name above it.
            named = FENCE.sub(r'```\1 title="\2"', own)
            here = posixpath.dirname(name)
            texts.append(LINK.sub(lambda link, here=here: _moved(link, here, folder), named))
        return "\n".join(texts)

    return INCLUDE.sub(place, ROOTED.sub(lambda link: _moved(link, "", folder), text))


def included(found: re.Match[str]) -> list[tuple[str, str]]:
    """Return the files that a line of a page includes, or their section, by their paths.

    Raises:
        ValueError: If a file or a section of it does not exist.
    """
    pattern, heading = found.groups()
    paths = sorted(path for path in ROOT.glob(pattern) if path.is_file())
    if not paths:
        raise ValueError(f"a page includes {pattern!r}, which is no file of the repository")
    texts = []
    for path in paths:
        name, own = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        own = own if heading is None else section(own, heading, name)
        # A page that is a section starts with its title.
        texts.append((name, own if found.start() else re.sub("^#+", "#", own)))
    return texts


def section(text: str, heading: str, name: str = "the text") -> str:
    """Return a section of a text: its heading, and all up to the next one of the same level.

    Raises:
        ValueError: If there is no such heading.
    """
    found: list[str] = []
    level, fenced = 0, False
    for line in text.splitlines():
        fenced ^= line.startswith("```")
        match = None if fenced else HEADING.match(line)
        if found and match and len(match[1]) <= level:
            break
        if found or (match and match[2] == heading):
            level = level or len(match[1]) if match else level
            found.append(line)
    if not found:
        raise ValueError(f"{name} has no section {heading!r}")
    return "\n".join(found) + "\n"


@cache
def homes() -> dict[str, str]:
    """Return the page that takes a file in, whole, by the file's path in the repository."""
    found = {}
    for page in sorted(PAGES.rglob("*.md")):
        for line in INCLUDE.finditer(page.read_text(encoding="utf-8")):
            if not line[2]:
                place = page.relative_to(PAGES).as_posix()
                found.update(dict.fromkeys((name for name, _ in included(line)), place))
    return found


def _moved(link: re.Match[str], folder: str, page: str) -> str:
    """Rewrite a link of an included text: to a page of the site, a picture, or to words alone."""
    picture, words, target, anchor = link.groups()
    path = posixpath.normpath(posixpath.join(folder, target))
    home = f"pictures/{path}" if picture else homes().get(path)
    if home is None:
        return words
    return f"{picture}[{words}]({posixpath.relpath(home, page or '.')}{anchor or ''})"


def pictures() -> list[str]:
    """Return the pictures of included texts, by their paths in the repository."""
    found: list[str] = []
    for page in sorted(PAGES.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        found += [target for _, _, target, _ in ROOTED.findall(text)]
        for name, own in (file for line in INCLUDE.finditer(text) for file in included(line)):
            here = posixpath.dirname(name)
            drawn = (target for mark, _, target, _ in LINK.findall(own) if mark)
            found += [posixpath.normpath(posixpath.join(here, target)) for target in drawn]
    return list(dict.fromkeys(found))


def rooms() -> dict[str, list[str]]:
    """Return the rooms of the house by layer, as the architecture lists them."""
    text = (ROOT / "data/docs/architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \| (`.+`) \|$", text, re.MULTILINE)
    return {layer: re.findall(r"`([\w.]+)`", names) for layer, names in rows}


def reference() -> dict[str, str]:
    """Return the pages of the reference by their place, one per room."""
    found = {}
    for layer, names in rooms().items():
        for name in names:
            # A room that only starts or gathers others has nothing of its own to read.
            if name in ("workbench", "workbench.__main__", "workbench.cli"):
                continue
            modules = "\n".join(f"::: {module}" for module in modules_of(name))
            title = f"# {name}\n\n{layer[0].upper()}{layer[1:]}.\n\n"
            found[f"reference/{name}.md"] = f"{title}{modules}\n"
    return found


def modules_of(room: str) -> list[str]:
    """Return the public modules of a room, by their dotted names."""
    place = ROOT / room.replace(".", "/")
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    return [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in files
        if not any(part.startswith("_") for part in path.relative_to(place.parent).parts)
    ]


@dataclass(frozen=True)
class Notebook:
    """A notebook as a page.

    Args:
        pictures: PNG files by their place on the site.
    """

    place: str
    title: str
    text: str
    pictures: dict[str, bytes]


@cache
def notebooks() -> list[Notebook]:
    """Return the notebooks; executed if the environment asks for it.

    One after the other: kernels that threads of one process talk to lose messages, and wait.
    """
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    read = _executed if os.environ.get("WORKBENCH_EXECUTE_NOTEBOOKS") else _as_stored
    return [_page_of(read(path), path.stem) for path in paths]


def _as_stored(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _executed(path: Path) -> Any:
    import nbformat
    from nbclient import NotebookClient

    content = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        NotebookClient(content, timeout=600, resources={"metadata": {"path": folder}}).execute()
    return content


def _page_of(content: Any, name: str) -> Notebook:
    lines: list[str] = []
    drawn: dict[str, bytes] = {}
    for cell in content["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            lines.append(source)
            continue
        lines.append(f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                file = f"{name}-{len(drawn) + 1}.png"
                drawn[f"notebooks/{file}"] = base64.b64decode("".join(data["image/png"]))
                lines.append(f"![]({file})")
            elif "text/html" in data:
                lines.append(f'<div class="output">{"".join(data["text/html"])}</div>')
            elif output.get("name") != "stderr" and not any("widget" in kind for kind in data):
                shown = "".join(data.get("text/plain", output.get("text", ())))
                lines.append(f"```text\n{shown.rstrip()}\n```")
    text = "\n\n".join(lines) + "\n"
    title = next(line[2:] for line in text.splitlines() if line.startswith("# "))
    return Notebook(f"notebooks/{name}.md", title, text, drawn)


def gallery() -> str:
    """Return the page that lists the notebooks, each with its first paragraph and a picture."""
    lines = ["# Notebooks", "Open them with `make notebooks`."]
    for found in notebooks():
        first = next(p for p in found.text.split("\n\n") if p.strip() and not p.startswith("#"))
        lines += [f"## [{found.title}]({posixpath.basename(found.place)})", first]
        lines += [f"![]({posixpath.basename(p)}){{ width=320 }}" for p in list(found.pictures)[:1]]
    return "\n\n".join(lines) + "\n"


# What mkdocs calls.


def on_config(config: Any) -> Any:
    """Add the notebooks and the reference to the navigation."""
    config["nav"] = [
        *config["nav"],
        {"Notebooks": ["notebooks/index.md", *(found.place for found in notebooks())]},
        {"Reference": list(reference())},
    ]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add generated pages and the pictures of included texts."""
    from mkdocs.structure.files import File

    made: dict[str, str | bytes] = {"notebooks/index.md": gallery(), **reference()}
    for found in notebooks():
        made |= {found.place: found.text, **found.pictures}
    for name in pictures():
        made[f"pictures/{name}"] = (ROOT / name).read_bytes()
    for place, content in made.items():
        files.append(File.generated(config, place, content=content))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Take included files in."""
    return taken_in(markdown, posixpath.dirname(page.file.src_uri))
