"""What a run depends on beside its description: files that were read, modules, packages.

A finished run is taken again only if all of it is as it was. Python itself tells which files are
opened (an audit hook, PEP 578), so that gains in a JSON file count wherever it stands. What comes
from environment variables, names of files or the network is not seen: ``--fresh`` does all again.
"""

from __future__ import annotations

import hashlib
import os
import sys
import sysconfig
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from typing import Any, NamedTuple

from workbench.computing.processes import begin_anew
from workbench.registry import own_modules

_WORKBENCH = str(Path(__file__).resolve().parents[1])
_CONTROLLERS = str(Path(_WORKBENCH).parent / "controllers")
_SITE = tuple({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")})
_SYSTEM = (
    sysconfig.get_path("stdlib"),
    sysconfig.get_path("platstdlib"),
    "/proc/",
    "/sys/",
    "/dev/",
    "/etc/",
    "/usr/",
)
_WRITES = os.O_WRONLY | os.O_RDWR


class Seen(NamedTuple):
    """What a process has read while it was watched.

    Args:
        files: Digest by path, of modules and of data; empty of one that was not there.
        packages: Names of imported top-level modules of installed packages.
    """

    files: dict[str, str]
    packages: tuple[str, ...]


class _Watch:
    """State of the process: an audit hook cannot be taken off again.

    Args:
        opened: Files that were read here while watched.
        digests: Digest by path, as it was when the file was first seen here.
        elsewhere: The same of processes that did runs for this one.
        forget: What lets go of what was made with code that has changed.
    """

    def __init__(self) -> None:
        self.depth = 0
        self.hooked = False
        self.opened: dict[str, None] = {}
        self.digests: dict[str, str] = {}
        self.elsewhere: dict[str, str] = {}
        self.forget: list[Callable[[], None]] = []


_WATCH = _Watch()


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if event not in ("open", "sqlite3.connect") or not _WATCH.depth:
        return
    path, flags = arguments[0], arguments[2] if event == "open" else 0
    if isinstance(path, (str, bytes, os.PathLike)) and not (flags or 0) & _WRITES:
        place = str(Path(os.fsdecode(path)).absolute())
        _WATCH.opened[place] = None
        _WATCH.digests.pop(place, None)


@contextmanager
def watched() -> Iterator[None]:
    """Note every file that is read inside."""
    if not _WATCH.hooked:
        _WATCH.hooked = True
        sys.addaudithook(_hook)
    _WATCH.depth += 1
    try:
        yield
    finally:
        _WATCH.depth -= 1
        if not _WATCH.depth:
            # A file that changes from now on is not the one that was read.
            seen()


def new_study(folder: Path) -> None:
    """Forget what earlier studies of this process, or of those that work for it, read of files.

    Only of those that changed since. A module of the user's own that changed is imported anew, as
    are those beside the study, which may have taken something from it.
    """
    changed = {path for path, known in _WATCH.digests.items() if digest(path) != known}
    if changed or any(digest(path) != known for path, known in _WATCH.elsewhere.items()):
        _WATCH.elsewhere.clear()
        begin_anew()
    if not changed:
        return
    own = str(folder.resolve()) + os.sep
    for name, place in own_modules().items():
        if name != "__main__" and (place in changed or place.startswith(own)):
            del sys.modules[name]
            changed.add(place)
    for path in changed:
        _WATCH.digests.pop(path, None)
        _WATCH.opened.pop(path, None)
    for forget in _WATCH.forget:
        forget()


def forgotten_with_its_code(forget: Callable[[], None]) -> None:
    """Call something when a study begins after files have changed that an earlier one has read."""
    _WATCH.forget.append(forget)


def seen_elsewhere(read: Seen) -> None:
    """Remember what a process that did a run has read: it may do one of a later study too."""
    _WATCH.elsewhere.update(read.files)


def seen() -> Seen:
    """Return what this process has read and imported."""
    files, packages = set(_WATCH.opened), set()
    for name, module in list(sys.modules.items()):
        place = getattr(module, "__file__", None)
        if not isinstance(place, str):
            continue
        if place.startswith(_SITE):
            packages.add(name.partition(".")[0])
        else:
            files.add(place)
    return Seen(
        {p: _at_first_sight(p) for p in sorted(files) if _counts(p)},
        tuple(sorted(packages)),
    )


@lru_cache(maxsize=4096)
def _counts(path: str) -> bool:
    own = path.startswith((_WORKBENCH, _CONTROLLERS)) and path.endswith(".py")
    return not (own or path.endswith((".pyc", ".so")) or path.startswith((*_SITE, *_SYSTEM)))


def _at_first_sight(path: str) -> str:
    if path not in _WATCH.digests:
        _WATCH.digests[path] = digest(path)
    return _WATCH.digests[path]


def digest(path: str) -> str:
    """Return a digest of a file as it is now; empty if it cannot be read."""
    try:
        with Path(path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()[:32]
    except OSError:
        return ""


_distributions = cache(packages_distributions)


def versions(modules: tuple[str, ...]) -> dict[str, str]:
    """Return the installed version of the packages that hold some top-level modules."""
    known = _distributions()
    names = {name for module in modules for name in known.get(module, ())}
    return {name: installed(name) for name in sorted(names)}


@cache
def installed(package: str) -> str:
    """Return the installed version of a package; empty if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
