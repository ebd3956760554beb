"""Files and folders of results, written whole or not at all, and numbers as JSON."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError


def _sentence(what: str, path: Path, error: OSError) -> WorkbenchError:
    reason = (error.strerror or str(error)).lower()
    return WorkbenchError(
        f"{what} {str(path)!r} cannot be written: {reason}; give a place where you may write"
    )


def _usual_permissions(path: Path, folder: bool) -> None:
    # Temporary files are private; results get what the user's umask gives any new file.
    umask = os.umask(0)
    os.umask(umask)
    path.chmod((0o777 if folder else 0o666) & ~umask)


def write_whole(path: str | os.PathLike[str], content: str | bytes) -> Path:
    """Write a file so that it is complete or as it was before.

    The content goes into a temporary file in the same folder, which then takes the place of the
    target in one step. Missing folders are made.

    Example:
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_whole(Path(folder) / "new" / "results.json", "{}").read_text()
        '{}'
    """
    target = Path(path)
    data = content.encode() if isinstance(content, str) else content
    if target.is_dir():
        raise WorkbenchError(f"file {str(target)!r} is a folder; give the name of a file")
    temporary = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}-", dir=target.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        _usual_permissions(Path(temporary), folder=False)
        Path(temporary).replace(target)
    except BaseException as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise _sentence("file", target, error) from None
        raise
    return target


def check_folder(path: str | os.PathLike[str]) -> Path:
    """Make a folder for results, before the work for them is done, and return it."""
    target = Path(path)
    if target.exists() and not target.is_dir():
        raise WorkbenchError(f"folder {str(target)!r} is a file; give the name of a folder")
    try:
        target.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=target).close()
    except OSError as error:
        raise _sentence("folder", target, error) from None
    return target


@contextmanager
def claimed(path: str | os.PathLike[str] | None) -> Iterator[None]:
    """Keep a folder of results, made if it is not there, to one run; None claims nothing.

    A second run is refused until the first has ended. The claim ends with the process, also with
    one that is killed; what a killed run left half written is removed first.

    Example:
        >>> with tempfile.TemporaryDirectory() as place, claimed(place):
        ...     with claimed(place):
        ...         pass
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: folder ... is in use by another run; ...
    """
    if path is None:
        yield
        return
    target, made = Path(path), not Path(path).exists()
    check_folder(target)
    try:
        import fcntl
    except ImportError:
        # A platform without such locks.
        yield
        return
    lock = target / ".lock"
    with lock.open("a", encoding="ascii") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise WorkbenchError(
                f"folder {str(target)!r} is in use by another run; wait until it has ended, or"
                " give another folder"
            ) from None
        try:
            _remove_leftovers(target.absolute())
            yield
        finally:
            lock.unlink(missing_ok=True)
            if made:
                # A run that wrote nothing leaves nothing.
                with suppress(OSError):
                    target.rmdir()


def _remove_leftovers(folder: Path) -> None:
    """Remove what runs that were killed had begun to write."""
    for place in (folder, *(p for p in folder.rglob("*") if p.is_dir())):
        for item in place.glob(".*-????????"):
            if item.is_file():
                item.unlink(missing_ok=True)
    for item in folder.parent.glob(f".{folder.name}-????????"):
        if item.is_dir():
            shutil.rmtree(item, ignore_errors=True)


@contextmanager
def whole_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Collect results in a temporary folder beside the target and move them when all are there.

    If the block raises, nothing in the target changes. Files that the target held before and that
    the block did not write again stay. A target that cannot be written is told before the block
    runs.

    Example:
        >>> with tempfile.TemporaryDirectory() as place:
        ...     with whole_folder(Path(place) / "out") as folder:
        ...         _ = (folder / "page.html").write_text("page")
        ...     (Path(place) / "out" / "page.html").read_text()
        'page'
    """
    target = Path(path).expanduser().absolute()
    if target.exists() and not target.is_dir():
        raise WorkbenchError(f"folder {str(target)!r} is a file; give the name of a folder")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():
            tempfile.TemporaryFile(dir=target).close()
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise _sentence("folder", target, error) from None
    try:
        yield temporary
        try:
            _move(temporary, target)
        except OSError as error:
            raise _sentence("folder", target, error) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _move(source: Path, target: Path) -> None:
    if not target.exists():
        _usual_permissions(source, folder=True)
        source.replace(target)
        return
    for item in sorted(source.iterdir()):
        if item.is_dir():
            _move(item, target / item.name)
        else:
            item.replace(target / item.name)


def json_text(results: Mapping[str, Any]) -> str:
    """Write numbers, arrays and words by name as JSON text; NaN and infinity become null."""
    return json.dumps(plain(results), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def picked(thing: Any, names: str) -> dict[str, Any]:
    """Return attributes of an object by name; ``title=attribute.of.it`` gives one another name.

    Example:
        >>> picked(3 + 4j, "real size=imag")
        {'real': 3.0, 'size': 4.0}
    """
    pairs = (name.partition("=") for name in names.split())
    return {name: attrgetter(path or name)(thing) for name, _, path in pairs}


def plain(value: Any) -> Any:
    """Return data as JSON has them: lists and mappings; None for a number that is not finite."""
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


@cache
def digest_of_code() -> bytes:
    """Return a digest of the workbench, and of the packages it computes with.

    What other code reached, it may not reach. What only shows results does not count.
    """
    package = Path(__file__).resolve().parent
    digest = hashlib.sha256(repr([version(n) for n in ("casadi", "numpy", "scipy")]).encode())
    for root in (package, package.parent / "controllers"):
        for path in sorted(root.rglob("*.py")):
            if not {"reports", "cli", "demo", "speed", "_data"} & set(path.relative_to(root).parts):
                digest.update(path.name.encode())
                digest.update(path.read_bytes())
    return digest.digest()
