"""A page in headless Chromium: a script measures it in a frame of a given width."""

from __future__ import annotations

import html as entities
import json
import re
import shutil
import subprocess
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
MEASURE = """
<script>
addEventListener("load", () => {
  const inner = document.querySelector("iframe").contentDocument;
  // What is folded must fit too.
  for (const folded of inner.querySelectorAll("details")) folded.open = true;
  const width = inner.documentElement.clientWidth;
  const name = e => e.tagName + ": " + e.textContent.trim().slice(0, 40);
  const outside = [...inner.querySelectorAll("body *")].filter(e => {
    const box = e.getBoundingClientRect();
    // A table scrolls in its own box, under its title; what is folded has no place.
    return (e.matches("caption *") || !e.closest("svg *, .table *")) && box.width > 0
      && (box.right > width + 1 || box.left < -1);
  }).map(name);
  // Of an overflowing cell the box fits but its content does not.
  const cells = [...inner.querySelectorAll("td, th, p, pre, h1, h2, figcaption")].filter(
    e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline").map(name);
  const figure = e => (e.closest("figure") || e).id;
  const share = (a, b) => {
    const w = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const h = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (w <= 0 || h <= 0) return 0;
    return w * h / Math.min(a.width * a.height, b.width * b.height);
  };
  const overlaps = (elements, limit) => {
    const found = [];
    const boxes = elements.map(e => e.getBoundingClientRect());
    for (let i = 0; i < boxes.length; i++) for (let j = 0; j < i; j++)
      if (share(boxes[i], boxes[j]) > limit)
        found.push(`${name(elements[j])} | ${name(elements[i])} in ${figure(elements[i])}`);
    return found;
  };
  let overlap = overlaps([...inner.querySelectorAll("section")], 0);
  for (const section of inner.querySelectorAll("section"))
    overlap = overlap.concat(overlaps([...section.querySelectorAll("figure, table, p, pre")], 0));
  // Boxes of text are a little larger than its letters.
  for (const svg of inner.querySelectorAll("svg"))
    overlap = overlap.concat(overlaps([...svg.querySelectorAll("text")], 0.25));
  const empty = [...inner.querySelectorAll("svg")].filter(
    e => e.getBoundingClientRect().height < 80 || e.querySelectorAll("path").length < 5).length;
  const texts = [...inner.querySelectorAll("svg text")].map(e => e.getBoundingClientRect().height);
  document.body.textContent = JSON.stringify({
    width, content: inner.documentElement.scrollWidth, outside, cells, overlap, empty,
    pictures: inner.querySelectorAll("svg").length, text: Math.min(...texts),
    ground: getComputedStyle(inner.querySelector("section")).backgroundColor,
  });
});
</script>
"""


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
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1600,1000"]
    options += [f"--user-data-dir={folder / 'profile'}", "--dump-dom"]
    options += [f"--blink-settings=preferredColorScheme={0 if dark else 1}"]
    command = [BROWSER, *options, path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r"<body>(\{.*\})</body>", done.stdout, re.DOTALL)
    assert found, done.stdout[-500:]
    return dict(json.loads(entities.unescape(found[1])))


def painted(colour: str) -> str:
    """Return a colour of six digits as a browser tells it."""
    return f"rgb({', '.join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))})"
