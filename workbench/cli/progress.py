"""Progress in plain words, on the error stream, so that results can be piped."""

from __future__ import annotations

import time

import typer


class Progress:
    """Says what is being done and how long it took."""

    def __init__(self, steps: int) -> None:
        """Start to count."""
        self._steps = steps
        self._step = 0
        self._begin = 0.0

    def __call__(self, what: str) -> None:
        """Say what is being done now."""
        self.done()
        self._step += 1
        self._begin = time.perf_counter()
        typer.echo(f"[{self._step}/{self._steps}] {what} ... ", err=True, nl=False)

    def done(self) -> None:
        """Say that the step is over."""
        if self._begin:
            typer.echo(f"{time.perf_counter() - self._begin:.1f} s", err=True)
        self._begin = 0.0
