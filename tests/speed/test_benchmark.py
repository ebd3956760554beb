"""The benchmark: ratios with spread, figures with a verdict, and a page that says both."""

from __future__ import annotations

import math

import pytest

from workbench.errors import WorkbenchError
from workbench.reports.page import html
from workbench.speed.benchmark import Benchmark, run_benchmark
from workbench.speed.measure import Comparison, Figure, Times, Way, tried
from workbench.speed.page import benchmark_page


def _comparison() -> Comparison:
    return Comparison(
        "open-loop",
        "Open loop",
        "simulated second",
        "difference, over the scales",
        (
            Way("workbench", Times((1.0, 2.0, 4.0)), 1e-8),
            Way("another", Times((20.0, 30.0, 40.0)), 1e-6),
            Way("missing", None, remark="not installed"),
        ),
    )


def test_a_ratio_has_the_widest_spread_of_its_times() -> None:
    assert _comparison().ratio("another") == (5.0, 15.0, 40.0)
    assert all(math.isnan(r) for r in _comparison().ratio("missing"))


def test_a_figure_is_reached_missed_or_open() -> None:
    assert Figure("fast", 3.0, "x", 2.0).reached
    assert Figure("late", 3.0, "s", 2.0, larger_is_better=False).reached is False
    assert Figure("unknown", math.nan, "s", 2.0).reached is None


def test_a_package_that_is_not_there_or_fails_is_a_line() -> None:
    assert "extra 'benchmark'" in tried("x", "no_such_package", lambda _: pytest.fail()).remark

    def failing(_: object) -> Way:
        raise ValueError("it gave up")

    assert tried("x", "math", failing).remark == "failed: it gave up"


def test_the_page_says_what_is_missed_and_why() -> None:
    late = Figure("late", 3.0, "s", 2.0, False, "the compiler takes 2.5 s")
    found = Benchmark([late, Figure("ok", 3.0, "x", 2.0)], [_comparison()], 12.0, 0.5)
    page = benchmark_page(found, command="make benchmark")
    assert page.marks == {"met": 1, "missed": 1, "open": 0}
    text = html(page).replace("\N{NO-BREAK SPACE}", " ")
    assert text.index("the compiler takes 2.5 s") < text.index("Reached")
    assert "not installed" in text
    assert "15.0 (5.00 to 40.0)" in text and "make benchmark" in text
    assert found.table()["comparisons"]["open-loop"]["ways"][1]["ratio"] == [5.0, 15.0, 40.0]


def test_one_part_runs_and_an_unknown_one_is_refused() -> None:
    found = run_benchmark(["linear-models"])
    assert [f.unit for f in found.figures] == ["ms", "ms"]
    assert all(f.value > 0.0 for f in found.figures)
    with pytest.raises(WorkbenchError, match="part of the benchmark"):
        run_benchmark(["everything"])
