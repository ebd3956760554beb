"""Work: counted in units that no machine changes, and shared among processes."""

import ctypes
import functools
import importlib.util
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables of the environment that say how many threads linear algebra has."""


def one_thread() -> None:
    """Keep linear algebra to one thread, unless the user says how many; called before NumPy loads.

    Matrices of a few rows are done sooner than threads that others keep from the cores meet.
    """
    for name in THREADS:
        os.environ.setdefault(name, "1")


@contextmanager
def in_one_thread() -> Iterator[None]:
    """Keep linear algebra to one thread for a while: in a notebook NumPy has loaded long ago."""
    before, given = [count() for count, _ in _thread_counts()], dict(os.environ)
    try:
        for _, set_count in _thread_counts():
            set_count(1)
        # What loads only now reads how many.
        one_thread()
        yield
    finally:
        for (_, set_count), number in zip(_thread_counts(), before, strict=True):
            set_count(number)
        for name in THREADS:
            if name not in given:
                os.environ.pop(name, None)


@functools.cache
def _thread_counts() -> list[tuple[Callable[[], int], Callable[[int], None]]]:
    """Return what reads and what sets the threads of each OpenBLAS that NumPy and SciPy bring."""
    found = []
    for package in ("numpy", "scipy"):
        spec = importlib.util.find_spec(package)
        home = Path(spec.origin).parent if spec and spec.origin else Path()
        for path in (*home.parent.glob(f"{package}.libs/*openblas*"), *home.glob(".dylibs/*blas*")):
            library = ctypes.CDLL(str(path))
            for end in ("64_", ""):
                names = [f"scipy_openblas_{verb}_num_threads{end}" for verb in ("get", "set")]
                if all(hasattr(library, name) for name in names):
                    found.append((getattr(library, names[0]), getattr(library, names[1])))
    return found
