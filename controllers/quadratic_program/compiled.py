"""The solver of `quadratic_program` in C: C99, no allocation, bounded iterations.

Exported controllers contain this text. Where a C compiler is present the simulation runs it too, so
that what is verified is what goes to the rig; it is built once and kept. The environment variable
``WORKBENCH_CC`` names another compiler, ``none`` means none.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path

from workbench.work.machine_code import built

TEXT = Path(__file__).with_name("solver.c")
"""The solver, for sizes that are defined before it."""

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""Flags of the compiler: no operation may be fused, so that every machine rounds alike."""


def solver_source(variables: int, rows: int, *, limit: int, factor: bool = True) -> str:
    """Return the solver for problems of one size as C source."""
    return (
        f"#define QP_N {variables} /* variables */\n"
        f"#define QP_ROWS {rows} /* constraints, then variables */\n"
        f"#define QP_LIMIT {limit} /* iterations after which it is given up */\n"
        + ("#define QP_FACTOR /* the matrices change from call to call */\n" if factor else "")
        + TEXT.read_text(encoding="utf-8")
    )


def solver_bytes(variables: int, rows: int, *, factor: bool = True) -> int:
    """Return the solver's own memory, in bytes, with 4 bytes for an integer."""
    numbers = (2 + factor) * variables**2 + 9 * variables + 3 * rows
    return 8 * numbers + 4 * (variables + 1) + rows


@lru_cache(maxsize=32)
def solver_library(variables: int, rows: int, limit: int) -> ctypes.PyDLL | None:
    """Return the built solver for problems of one size, or None without a compiler."""
    source = solver_source(variables, rows, limit=limit) + _ENTRIES
    library = built("quadratic_program", source, FLAGS)
    return None if library is None else ctypes.PyDLL(str(library))


_ENTRIES = """
int factor(const double *H, const double *A, double *inverse, double *rows, double *sizes) {
  return qp_factor(H, A, inverse, rows, sizes);
}

int solve(const double *inverse, const double *rows, const double *sizes, const double *g,
          const double *lower, const double *upper, double *x, int *iterations) {
  return qp_solve(inverse, rows, sizes, g, lower, upper, x, iterations);
}
"""
