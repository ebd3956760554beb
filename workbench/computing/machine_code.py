"""C code as machine code: built once, kept by its content, used only if it is undamaged."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

from workbench.computing.counted import count
from workbench.errors import WorkbenchError

PLAIN = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""What every compiler takes. Products are rounded before they are added, so that machine code gives
the very numbers that an interpreted model gives."""

FAST = (
    "-O3",
    "-march=native",
    "-fno-semantic-interposition",
    "-fno-math-errno",
    "-fno-trapping-math",
    *PLAIN[1:],
)
"""The same numbers about twice as fast: products of matrices become part of the code around them,
in the instructions of this very processor."""

SOON = ("-Og", "-fno-math-errno", "-fno-trapping-math", "-nostdlib", *PLAIN[1:])
"""For the equations of a model, which have next to no loops and call nothing but mathematics: built
in a sixth of the time, and a fifth slower than ``FAST``. A search builds dozens of them, each for
some seconds of work."""

_DIGEST = hashlib.sha256().digest_size


@functools.cache
def compiler() -> str | None:
    """Return the path of a C compiler; None where there is none, and models are interpreted.

    The environment variable ``WORKBENCH_CC`` names another compiler, or ``none``.
    """
    wanted = os.environ.get("WORKBENCH_CC", "")
    if wanted == "none":
        return None
    if wanted:
        found = shutil.which(wanted)
        if found is None:
            raise WorkbenchError(
                f"WORKBENCH_CC is {wanted!r}, which is not a program on the path; name a C"
                " compiler such as gcc or clang, or 'none' to interpret models"
            )
        return found
    if sys.platform == "win32":
        return None
    return next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name))), None)


@functools.cache
def _processor() -> str:
    """Return what tells this kind of processor from others that may share the cache."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


def cache_folder() -> Path:
    """Return the folder in which built functions are kept, made if it is not there.

    ``WORKBENCH_CACHE`` names another folder; by default it is in the user's cache folder, or in
    the folder for temporary files where that cannot be written.
    """
    base = os.environ.get("WORKBENCH_CACHE")
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    for folder in (Path(base or home) / "workbench", Path(tempfile.gettempdir()) / "workbench"):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="workbench-"))


def built(
    name: str, source: str, flags: tuple[str, ...], *, headers: Path | None = None
) -> Path | None:
    """Build C code as a shared library, unless it was built before.

    Args:
        name: What the library is called in the cache.
        flags: ``PLAIN``, ``FAST`` or ``SOON``.
        headers: Folder of the headers that the code includes; they count as part of the code.

    Returns:
        The library, or None where there is no C compiler or it fails, with a warning.
    """
    cc = compiler()
    if cc is None:
        return None
    included = sorted(headers.glob("*.h")) if headers else []
    made_by = (cc, *flags, source, *(h.read_text() for h in included))
    if flags is FAST:
        made_by = (*made_by, _processor())
    key = hashlib.sha256("\0".join(made_by).encode())
    library = cache_folder() / f"{name}-{key.hexdigest()[:24]}.so"
    if not _undamaged(library):
        try:
            _build(cc, flags + ((f"-I{headers}",) if headers else ()), source, library)
        except OSError as error:
            _warn(f"the folder {str(library.parent)!r} cannot be written: {error.strerror}")
    return library if _undamaged(library) else None


def _undamaged(library: Path) -> bool:
    """Whether a library is there as it was built: it ends with a digest of the rest."""
    try:
        content = library.read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-_DIGEST]).digest() == content[-_DIGEST:]


def _loads(library: Path) -> bool:
    """Whether a library is one: a program that is no compiler may have made anything."""
    try:
        ctypes.CDLL(str(library))
    except OSError:
        return False
    return True


def _warn(reason: str) -> None:
    warnings.warn(
        f"a model is interpreted, which is slower: {reason}", RuntimeWarning, stacklevel=4
    )


def _build(cc: str, flags: tuple[str, ...], source: str, library: Path) -> None:
    # Built under another name and moved, so that a parallel run never loads a half-written file.
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        code = Path(folder) / "code.c"
        built = Path(folder) / "code.so"
        code.write_text(source)
        plain = PLAIN + tuple(flag for flag in flags if flag.startswith("-I"))
        for asked in (flags, plain):
            done = subprocess.run(
                [cc, *asked, "-o", str(built), str(code), "-lm"],
                capture_output=True,
                text=True,
                check=False,
            )
            count("compilations")
            if done.returncode == 0:
                break
        if done.returncode == 0 and _loads(built):
            content = built.read_bytes()
            with built.open("ab") as stream:
                stream.write(hashlib.sha256(content).digest())
            built.replace(library)
        else:
            _warn(f"{cc} could not build it: {done.stderr.strip()[:200]}")
