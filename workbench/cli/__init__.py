"""The command line: each verb calls one function; mistakes get one sentence and status 2."""

from workbench.computing import one_thread

one_thread()

from workbench.cli.main import main  # noqa: E402

__all__ = ["main"]
