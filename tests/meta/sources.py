"""The modules and texts that the meta-tests look at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("workbench", "controllers")
SKIPPED_FOLDERS = {"build", "dist", "demo", "node_modules", "__pycache__"}


def module_name(path: Path, root: Path = ROOT) -> str:
    """Return the dotted name of a module's file.

    Example:
        >>> module_name(ROOT / "workbench" / "model" / "__init__.py")
        'workbench.model'
    """
    parts = list(path.relative_to(root).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def module_files(root: Path = ROOT) -> list[Path]:
    """Return the files of every module of the packages, sorted."""
    return sorted(path for package in PACKAGES for path in (root / package).rglob("*.py"))


def public_module_files(root: Path = ROOT) -> list[Path]:
    """Return the files of the modules without a leading underscore in their dotted name."""
    return [
        path
        for path in module_files(root)
        if not any(part.startswith("_") for part in module_name(path, root).split("."))
    ]


def texts(suffixes: set[str], root: Path = ROOT) -> Iterator[Path]:
    """Yield the files of the checkout with one of the suffixes, without caches and links."""
    for path in sorted(root.iterdir()):
        if path.is_symlink() or path.name in SKIPPED_FOLDERS or path.name.endswith(".egg-info"):
            continue
        if path.is_dir():
            if path.name == ".ci" or not path.name.startswith("."):
                yield from texts(suffixes, path)
        elif path.suffix in suffixes and path.name != ".git":
            yield path
