"""The command line: each verb calls one function; mistakes get one sentence and status 2."""

from workbench.cli.main import main

__all__ = ["main"]
