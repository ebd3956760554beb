"""Functions as machine code: CasADi writes them in C."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from workbench.work.machine_code import FAST, built, compiler


def compiled(function: ca.Function) -> ca.Function:
    """Return the function as machine code where a C compiler exists, unchanged otherwise."""
    if compiler() is None:
        return function
    library = built(function.name(), generated([function]), FAST)
    return function if library is None else ca.external(function.name(), str(library))


def generated(functions: Sequence[ca.Function]) -> str:
    """Return C code of functions, which stand in it under their names."""
    generator = ca.CodeGenerator(f"{functions[0].name()}.c")
    for function in functions:
        generator.add(function)
    return str(generator.dump())
