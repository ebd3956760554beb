"""Compiled and interpreted simulation give the same numbers; the cache is by content."""

from __future__ import annotations

import ctypes
import itertools
import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from workbench.computing.counted import done, since
from workbench.computing.machine_code import SOON, built, compiler
from workbench.errors import WorkbenchError
from workbench.simulation.equations import Equations, address, compiled

SCRIPT = """
import sys
import numpy as np
from workbench.plants.arm import arm
from workbench.simulation import simulate
voltage = np.where(np.arange(500) < 250, 5.9, 4.1)
run = simulate(arm(3.0), voltage, sample_time=0.002, check=False)
print(run.integrator)
np.save(sys.argv[1], np.hstack([run.states, run.outputs]))
"""


def run_with(setting: dict[str, str], target: Path) -> tuple[str, np.ndarray]:
    # As in the tests themselves: the package may be found through the path only.
    environment = {**os.environ, **setting, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(target)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), np.load(target)


@pytest.mark.skipif(compiler() is None, reason="there is no C compiler to compare with")
def test_compiled_and_interpreted_runs_are_the_same(tmp_path: Path) -> None:
    cache = {"WORKBENCH_CACHE": str(tmp_path / "cache")}
    fast, compiled_states = run_with(cache, tmp_path / "a.npy")
    slow, interpreted_states = run_with({"WORKBENCH_CC": "none", **cache}, tmp_path / "b.npy")
    assert (fast, slow) == ("erk, compiled", "erk, interpreted")
    # The same operations in the same order: only the compiler's own rounding may differ.
    scale = np.abs(interpreted_states).max(axis=0) + 1e-12
    assert (np.abs(compiled_states - interpreted_states) / scale).max() < 1e-9
    assert list((tmp_path / "cache" / "workbench").glob("*.so"))


@pytest.mark.skipif(compiler() is None, reason="there is no C compiler")
def test_what_is_a_line_stands_in_the_equations_and_gives_the_same_numbers() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    limits = [ca.fmax(x, y), ca.fmin(x, y), ca.fmax(x, 0.0), x**2, ca.sign(x), ca.fabs(y)]
    equations = Equations((ca.Function("limits", [x, y, ca.SX(0, 1)], limits),))
    function, numbers = equations.in_c(0), np.zeros(len(limits))
    places = (ctypes.c_void_p * len(limits)).from_address(function.res)
    places[:] = [address(numbers[i:]) for i in range(len(limits))]
    call = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 4, ctypes.c_int)(function.call)
    for given in itertools.product((-np.inf, -2.0, -0.0, 0.0, 1.5, np.inf, np.nan), repeat=2):
        at = np.array(given)
        (ctypes.c_void_p * 2).from_address(function.arg)[:] = [address(at[:1]), address(at[1:])]
        assert call(function.arg, function.res, function.iw, function.w, 0) == 0
        np.testing.assert_array_equal(numbers, np.ravel(equations.in_python[0](*given, [])))
    # Nor is there what only a loader of CasADi would call: most lines of a small function.
    assert not any(hasattr(equations._library, f"limits_{n}") for n in ("fmax", "n_in", "work"))


@pytest.mark.skipif(compiler() is None, reason="there is no C compiler")
def test_a_function_is_built_once_per_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    x = ca.SX.sym("x")
    for factor in (2.0, 3.0, 2.0):
        assert float(compiled(ca.Function("f", [x], [factor * x]))(5.0)) == 5.0 * factor
    assert len(list((tmp_path / "workbench").glob("*.so"))) == 2
    assert [p for p in (tmp_path / "workbench").iterdir() if p.is_dir()] == []


def test_a_damaged_library_is_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    library = built("f", "double f(void) { return 2.0; }", SOON)
    assert library is not None
    whole = library.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], whole[:-1] + b"x"):
        # As another file: this process has loaded the whole one.
        library.unlink()
        library.write_bytes(damaged)
        assert built("f", "double f(void) { return 2.0; }", SOON) == library
        assert library.read_bytes() == whole
    # What is whole is not built again.
    before = done()
    assert built("f", "double f(void) { return 2.0; }", SOON) == library
    assert since(before)["compilations"] == 0


@pytest.mark.usefixtures("forgotten")
def test_a_compiler_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORKBENCH_CC", "no-such-compiler")
    with pytest.raises(WorkbenchError, match="'no-such-compiler'"):
        compiler()


@pytest.mark.usefixtures("forgotten")
def test_a_compiler_that_fails_leaves_the_interpreter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho broken >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("WORKBENCH_CC", str(broken))
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    x = ca.SX.sym("x")
    with pytest.warns(RuntimeWarning, match="could not build it: broken"):
        function = compiled(ca.Function("f", [x], [x + 1.0]))
    assert float(function(1.0)) == 2.0
