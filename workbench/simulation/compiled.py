"""Compiled CasADi functions: C code generated, built once and cached by its content."""

from __future__ import annotations

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

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError

_FLAGS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""What every compiler takes. Products are rounded before they are added, so that machine code gives
the very numbers that an interpreted model gives."""

_FAST_FLAGS = (
    "-O3",
    "-march=native",
    "-fno-semantic-interposition",
    "-fno-math-errno",
    "-fno-trapping-math",
    *_FLAGS[1:],
)
"""The same numbers about twice as fast: products of matrices become part of the code around them,
in the instructions of this very processor."""

_QUICK_FLAGS = ("-Og", *_FLAGS[1:])
"""The same numbers, built in a sixth of the time: for code that runs for less than a second."""


@functools.cache
def compiler() -> str | None:
    """Return the path of a C compiler, or None where there is none.

    The environment variable ``WORKBENCH_CC`` names another compiler; ``none`` means that models
    are interpreted.

    Returns:
        Path of the program, or None if models are interpreted.

    Raises:
        WorkbenchError: If ``WORKBENCH_CC`` names a program that does not exist.
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


def compiled(function: ca.Function, *, quick: bool = False) -> ca.Function:
    """Return the function as machine code where a C compiler exists, unchanged otherwise.

    Args:
        function: A CasADi function that can be generated as C.
        quick: Whether code that is built soon is worth more than code that runs fast; what was
            built before to run fast is taken all the same.

    Returns:
        A function with the same signature and the same results.

    Example:
        >>> x = ca.SX.sym("x")
        >>> float(compiled(ca.Function("twice", [x], [2 * x]))(3.0))
        6.0
    """
    cc = compiler()
    if cc is None:
        return function
    name = function.name()
    generator = ca.CodeGenerator(f"{name}.c")
    generator.add(function)
    source = generator.dump()
    libraries = {
        flags: _library(name, (ca.CasadiMeta.version(), cc, *flags, _processor(), source))
        for flags in (_FAST_FLAGS, _QUICK_FLAGS)
    }
    flags = _QUICK_FLAGS if quick and not libraries[_FAST_FLAGS].exists() else _FAST_FLAGS
    library = libraries[flags]
    if not library.exists():
        _build(cc, flags, source, library)
    if not library.exists():
        return function
    return ca.external(name, str(library))


def _library(name: str, made_by: tuple[str, ...]) -> Path:
    key = hashlib.sha256("\0".join(made_by).encode())
    return cache_folder() / f"{name}-{key.hexdigest()[:24]}.so"


class Buffered:
    """A CasADi function of matrices, called without the cost of converting its arguments.

    Args:
        function: The function; its first output is returned.
        shapes: Shape of each argument.

    Example:
        >>> x = ca.SX.sym("x", 2)
        >>> twice = Buffered(ca.Function("twice", [x], [2 * x]), (2, 1))
        >>> twice([[1.0], [2.0]]).tolist()
        [[2.0], [4.0]]
    """

    def __init__(self, function: ca.Function, *shapes: tuple[int, int]) -> None:
        self._buffer, self._call = function.buffer()
        # CasADi stores matrices by columns.
        self.arguments = [np.zeros(shape, order="F") for shape in shapes]
        for i, array in enumerate(self.arguments):
            self._buffer.set_arg(i, array.reshape(-1, order="F").data)
        self.result: npt.NDArray[np.float64] = np.zeros(function.size_out(0), order="F")
        self._buffer.set_res(0, self.result.reshape(-1, order="F").data)

    def __call__(self, *values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the function's first output for new arguments.

        Args:
            values: Arguments of the shapes given, in the function's units.

        Returns:
            The output; the next call overwrites it.

        Raises:
            RuntimeError: If the function fails.
        """
        for array, value in zip(self.arguments, values, strict=True):
            array[:] = value
        return self.evaluate()

    def evaluate(self) -> npt.NDArray[np.float64]:
        """Return the function's first output for what ``arguments`` hold now.

        Returns:
            The output, in the function's unit; the next call overwrites it.

        Raises:
            RuntimeError: If the function fails.
        """
        self._call()
        if self._buffer.ret():
            raise RuntimeError("a compiled function failed")
        return self.result


def _build(cc: str, fast: tuple[str, ...], source: str, library: Path) -> None:
    # Built under another name and moved, so that a parallel run never loads a half-written file.
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        code = Path(folder) / "code.c"
        built = Path(folder) / "code.so"
        code.write_text(source)
        for flags in (fast, _FLAGS):
            done = subprocess.run(
                [cc, *flags, "-o", str(built), str(code), "-lm"],
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode == 0:
                break
        if done.returncode == 0:
            built.replace(library)
        else:
            warnings.warn(
                f"{cc} could not build a model, which is interpreted instead:"
                f" {done.stderr.strip()[:200]}",
                RuntimeWarning,
                stacklevel=3,
            )
