"""Lines of entries, on a text that uses every way of writing them."""

from __future__ import annotations

import pytest

from workbench.study.toml_lines import line_of

TEXT = '''# a comment [not.a.table]
name = "a # b" # x
[plant]
load = "3 kg"
parameters = { a = 1, "b.c" = [1,
2] }
[scenarios."step up"]
changes = [
  { time = 1, parameter = "x" }, # ]

  { time = 2 },
]
text = """
x = [ " ""
"""
[scenarios."step up".references.angle]
kind = 'si]ne'
[[requirements]]
metric = "a"
[[requirements]]
metric.x = "b\\"]"
[requirements.more]
date = 2026-01-01T00:00:00Z
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ((), 1),
        (("name",), 2),
        (("plant",), 3),
        (("plant", "parameters", "b.c", 1), 6),
        (("scenarios", "step up", "changes", 0, "parameter"), 9),
        (("scenarios", "step up", "changes", 1, "time"), 11),
        (("scenarios", "step up", "references", "angle", "kind"), 17),
        (("requirements", 0, "metric"), 19),
        (("requirements", 1), 20),
        (("requirements", 1, "metric", "x"), 21),
        (("requirements", 1, "more", "date"), 23),
    ],
)
def test_line(path: tuple[str | int, ...], line: int) -> None:
    assert line_of(TEXT, path) == line


def test_a_missing_entry_stands_where_its_table_does() -> None:
    assert line_of(TEXT, ("plant", "supply")) == 3
    assert line_of("", ("plant", "supply")) == 1
