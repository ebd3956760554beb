from pathlib import Path
from typing import Any

import pytest

from tests.recordings.example import Read
from workbench.recordings import Recording, read_recording


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """What is read of a file that holds a text, some lines or some bytes."""

    def reading(content: Any, name: str = "trial.csv", **options: Any) -> Recording:
        path = tmp_path / name
        if not isinstance(content, str | bytes):
            content = "\n".join(content)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return read_recording(path, **options)

    return reading
