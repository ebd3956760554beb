"""A page in headless Chromium: a script measures it in a frame of a given width."""

from __future__ import annotations

import html as entities
import json
import re
import shutil
import subprocess
from pathlib import Path

BROWSER = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (path := shutil.which(name))
    ),
    None,
)


def measured(
    text: str, script: str, width: int, folder: Path, *, dark: bool = False
) -> dict[str, object]:
    """Return what a script that ends with JSON as the page's text finds in the page."""
    # Windows of a browser have a smallest width; a frame has none.
    frame = (
        f'<iframe style="width:{width}px;height:900px;border:0"'
        f' srcdoc="{entities.escape(text)}"></iframe>'
    )
    path = folder / "frame.html"
    path.write_text(f"<!doctype html><body>{frame}{script}</body>", encoding="utf-8")
    assert BROWSER is not None
    done = subprocess.run(
        [
            BROWSER,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--window-size=1600,1000",
            f"--user-data-dir={folder / 'profile'}",
            f"--blink-settings=preferredColorScheme={0 if dark else 1}",
            "--dump-dom",
            path.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    found = re.search(r"<body>(\{.*\})</body>", done.stdout, re.DOTALL)
    assert found, done.stdout[-500:]
    return dict(json.loads(entities.unescape(found[1])))
