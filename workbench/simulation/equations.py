"""The functions of a model's equations, for C code and for Python, and what builds them."""

from __future__ import annotations

import ctypes
import functools
import re
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.computing.buffered import Buffered
from workbench.computing.machine_code import FAST, SOON, built, compiler


def compiled(function: ca.Function) -> ca.Function:
    """Return the function as machine code where a C compiler exists, unchanged otherwise."""
    if compiler() is None:
        return function
    library = built(function.name(), generated([function]), SOON)
    return function if library is None else ca.external(function.name(), str(library))


def generated(functions: Sequence[ca.Function]) -> str:
    """Return C code of functions, which stand in it under their names."""
    generator = ca.CodeGenerator(f"{functions[0].name()}.c")
    for function in functions:
        generator.add(function)
    source = str(generator.dump())
    # Squares and the larger of two, a line each, stand where they are used.
    source = re.sub(r"^(?=casadi_real casadi_\w+\()", _INLINE, source, flags=re.MULTILINE)
    for name, sign in (("fmax", ">"), ("fmin", "<")):
        source = source.replace(f"return {name}(x, y);", f"return x {sign} y || y != y ? x : y;")
    return source


_INLINE = "static inline __attribute__((always_inline)) "

_FOR_LOADER = (
    r"^CASADI_SYMBOL_EXPORT (?!int \w+\(const casadi_real\*\* arg)"
    r"[^\n]*(?:\}|\{\n(?:[^}\n][^\n]*\n|\n)*\})\n"
)
"""A function of the C code that is not one of the equations, up to the bracket that closes it."""

_HERE = Path(__file__).parent


class CFunction(ctypes.Structure):
    """What `equations.h` calls ``Function``: a function and the memory that it works in."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("call", "arg", "res", "iw", "w")]

    def __init__(self, call: int, *memory: int) -> None:
        super().__init__(call, *memory)


class Equations:
    """Functions of states, inputs and parameters (and what else they take), in one library.

    Each object has its own memory, so objects may work in parallel threads, one thread each.

    Args:
        flags: Those of the compiler.
    """

    def __init__(self, functions: Sequence[ca.Function], flags: tuple[str, ...] = SOON) -> None:
        self.functions = tuple(functions)
        self._library = _library(self.functions, flags)
        self._kept: list[tuple[npt.NDArray[np.generic], ...]] = []

    @property
    def compiled(self) -> bool:
        """Whether they are machine code."""
        return self._library is not None

    def in_c(self, i: int) -> CFunction:
        """Return the i-th function for C code, which says where the results go."""
        assert self._library is not None
        place, (pointers, results, integers, numbers) = _entry(self._library, self.functions[i])
        memory = (
            np.zeros(pointers, dtype=np.uintp),
            np.zeros(results, dtype=np.uintp),
            np.zeros(integers, dtype=np.int64),
            np.zeros(numbers),
        )
        self._kept.append(memory)
        return CFunction(place, *(array.ctypes.data for array in memory))

    @functools.cached_property
    def in_python(self) -> list[Buffered]:
        """The functions, to be called in Python."""
        return [Buffered(function) for function in self.functions]

    def __call__(self, i: int, *values: npt.ArrayLike) -> Vector:
        """Return the first result of the i-th function, a vector, in Python."""
        return self.in_python[i](*values)[0].flatten()


def in_c(file: Path) -> ctypes.CDLL | None:
    """Return a C file of the workbench as a library, or None where there is no C compiler."""
    library = built(file.stem, file.read_text(), FAST, headers=_HERE)
    return None if library is None else ctypes.CDLL(str(library))


def address(array: Vector) -> int:
    """Return where an array of doubles stands in memory, for C code.

    It must be contiguous and kept alive.
    """
    assert array.flags.c_contiguous and array.dtype == np.float64
    return array.ctypes.data


@functools.lru_cache(maxsize=512)
def _entry(library: ctypes.CDLL, function: ca.Function) -> tuple[int, tuple[int, ...]]:
    """Return where a function of a library stands, and the sizes of the memory that it needs."""
    place = ctypes.cast(getattr(library, function.name()), ctypes.c_void_p).value or 0
    sizes = function.sz_arg(), function.sz_res(), function.sz_iw(), function.sz_w()
    return place, tuple(max(1, size) for size in sizes)


@functools.lru_cache(maxsize=128)
def _library(functions: tuple[ca.Function, ...], flags: tuple[str, ...]) -> ctypes.CDLL | None:
    if compiler() is None:
        return None
    # Each argument and result is there: nothing asks for it. What only CasADi's own loader calls,
    # most of the lines of a small function, is left out.
    source = re.sub(r"\b(arg\[\d+\])\? (\1\[\d+\]) : 0;", r"\2;", generated(functions))
    source = re.sub(r"\bif \(res\[\d+\]!=0\) ", "", source)
    source = re.sub(_FOR_LOADER, "", source, flags=re.MULTILINE)
    library = built("_".join(f.name() for f in functions), source, flags)
    return None if library is None else ctypes.CDLL(str(library))
