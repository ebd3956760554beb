"""What the README shows runs as it stands, and what it claims of it is true."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"


def test_the_lines_of_python_design_and_verify_a_controller() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(code.strip().splitlines()) <= 18
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(README), "exec"), {})
    settled = [float(t) for t in re.findall(r"settling_time\s+(\S+) s", printed.getvalue())]
    assert len(settled) == 3
    # On the full plant, without and with hysteresis; the linear model is faster.
    assert max(settled[1:]) < 0.5


def test_folders_and_files_that_are_named_exist() -> None:
    root = README.parent
    text = README.read_text(encoding="utf-8")
    named = re.findall(
        r"`((?:workbench|controllers|data)/[\w./-]+)`|[(\"](data/[^)\"]+)[)\"]", text
    )
    for path in (a or b for a, b in named):
        assert (root / path).exists(), path
