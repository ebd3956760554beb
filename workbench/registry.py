"""Registries: each kind of thing that a user can add to the workbench stands in one of them.

A registry collects its members from three places, none of which is a list of names: the modules of
one package of the workbench (every object of the member's class is a member), installed packages
that announce an entry point, and the user's own modules, where a member is written as
``module:object``.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
import sysconfig
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, Generic, TypeVar, cast

from workbench.errors import WorkbenchError, check_choice

Member = TypeVar("Member")


class Registry(Generic[Member]):
    """All members of one kind, by name.

    A member is an object of ``member`` with an attribute ``name``. Names are compared with hyphens
    and underscores taken as the same.

    Args:
        kind: What a member is, as the user knows it: ``"plant"``.
        package: Package of the workbench whose modules define the built-in members, or several;
            searched when a name is first asked for.
        group: Group of entry points through which installed packages add members.
        adopt: Turns another object that a user named, such as a plain function, into a member; it
            gets the object and the reference. Without it only objects of ``member`` are taken.

    Example:
        >>> from workbench.errors import WorkbenchError
        >>> errors = Registry("error", type, package="workbench.errors", group="example.errors")
        >>> errors.get("workbench.errors:WorkbenchError") is WorkbenchError
        True
    """

    def __init__(
        self,
        kind: str,
        member: type[Member],
        *,
        package: str | tuple[str, ...],
        group: str,
        adopt: Callable[[Any, str], Member] | None = None,
    ) -> None:
        self.kind, self.member, self.group = kind, member, group
        self.packages = (package,) if isinstance(package, str) else package
        self._adopt = adopt
        self._members: dict[str, Member] | None = None
        self._broken: dict[str, str] = {}

    def members(self) -> dict[str, Member]:
        """Return the built-in and the installed members by name, in the order of their names.

        What an installed package announces and cannot be loaded, or has the name of another one, is
        left out with a warning: it must not stop who wants something else.

        Raises:
            WorkbenchError: If two built-in members have the same name.
        """
        if self._members is None:
            found: dict[str, Member] = {}
            for origin, member in self._built_in():
                self._join(found, origin, member)
            for entry in entry_points(group=self.group):
                package = getattr(getattr(entry, "dist", None), "name", "an installed package")
                try:
                    with user_code(f"{self.kind} {entry.name!r} of {package}"):
                        self._join(found, package, self.taken(entry.load(), entry.name))
                except WorkbenchError as error:
                    self._broken[_plain(entry.name)] = str(error)
                    warnings.warn(f"{error}; it is left out", stacklevel=2)
            self._members = dict(sorted(found.items()))
        return dict(self._members)

    def _join(self, found: dict[str, Member], origin: str, member: Member) -> None:
        name = str(cast(Any, member).name)
        if found.setdefault(name, member) is not member:
            raise WorkbenchError(
                f"{self.kind} {name!r} of {origin} has the name of another {self.kind}; rename one"
                " of them"
            )

    def names(self) -> tuple[str, ...]:
        """Return the names of all members."""
        return tuple(self.members())

    def get(self, name: str, *, folder: Path | None = None) -> Member:
        """Return a member by its name or as ``module:object`` of the user's own.

        Args:
            folder: Where the user's module may stand, beside the Python path.
        """
        if ":" in name:
            return self.taken(load_object(self.kind, name, folder=folder), name)
        members = self.members()
        wanted = _plain(name)
        for known, member in members.items():
            if _plain(known) == wanted:
                return member
        if wanted in self._broken:
            raise WorkbenchError(self._broken[wanted])
        try:
            check_choice(self.kind, name, members)
        except WorkbenchError as error:
            stem, _, rest = name.rpartition(".")
            own = f"{stem}:{rest}" if ((folder or Path()) / f"{stem}.py").is_file() else ""
            own = f"{stem}:NAME" if rest == "py" else own or "module:object"
            raise WorkbenchError(f"{error}; write one of your own as {own}") from None
        raise AssertionError("unreachable")

    def taken(self, found: object, reference: str) -> Member:
        """Return an object that a user named, as a member."""
        if isinstance(found, self.member):
            return found
        if self._adopt is None:
            raise WorkbenchError(
                f"{self.kind} {reference!r} is a {type(found).__name__}; it must be a"
                f" {self.member.__name__}"
            )
        return self._adopt(found, reference)

    def _built_in(self) -> Iterator[tuple[str, Member]]:
        seen: set[int] = set()
        for module in (m for package in self.packages for m in _modules(package)):
            for value in vars(module).values():
                if isinstance(value, self.member) and id(value) not in seen:
                    seen.add(id(value))
                    yield module.__name__, value


def load_object(kind: str, reference: str, *, folder: Path | None = None) -> Any:
    """Return an object of a user's own module.

    Args:
        kind: What the object stands for, as the user knows it.
        reference: ``module:object``; the object may be dotted, and a file stand for its module,
            ``rigs/mine.py:object``.
        folder: Folder of the module; searched before the Python path for this import, and after it
            for what the module imports when it is called.

    Raises:
        WorkbenchError: If the reference is not of that form, the module cannot be imported or has
            no such object; a mistake inside the module is told with its file and line.
    """
    module_name, sign, path = reference.rpartition(":")
    if module_name.endswith(".py"):
        file = (folder or Path.cwd()) / module_name
        folder, module_name = file.parent, file.stem
    if not sign or not path or not module_name.replace(".", "_").isidentifier():
        raise WorkbenchError(f"{kind} is {reference!r}; write one of your own as module:object")
    with user_code(f"{kind} {reference!r}"), _searched(folder):
        found: Any = _import(module_name, folder)
    for part in path.split("."):
        if not hasattr(found, part):
            known = [n for n, o in vars(found).items() if n[0] != "_" and _own(o, module_name)]
            check_choice(f"object of {module_name} for {kind}", part, known)
        found = getattr(found, part)
    return found


def _own(found: object, module: str) -> bool:
    """Whether an object is none that a module imports."""
    imported = isinstance(found, (ModuleType, type, FunctionType))
    return not imported or getattr(found, "__module__", "") == module


@contextmanager
def user_code(what: str) -> Iterator[None]:
    """Turn whatever a user's own code raises into one sentence with file and line.

    ``SystemExit`` counts as a mistake too: a module that leaves the process must not look like a
    run without misses.

    Args:
        what: What was being done with the code, as the user knows it.

    Raises:
        WorkbenchError: The mistake; errors of the workbench pass unchanged.

    Example:
        >>> with user_code("design 'mine:fast'"):
        ...     1 / 0
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: design 'mine:fast' failed: ZeroDivisionError: ...
    """
    try:
        yield
    except (WorkbenchError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise WorkbenchError(f"{what} failed: {told(error)}") from error


def told(error: BaseException) -> str:
    """Return what went wrong, with file and line: in the user's own code where it passed there."""
    text = f"{type(error).__name__}: {error}".removesuffix(": ")
    if isinstance(error, SystemExit):
        text = f"it left the process with {error}, which a module must not do"
    if "truth value of a CasADi" in text:
        text = (
            "values of a model are symbols, by which 'if', 'and', 'min' and 'max' cannot decide:"
            " take np.where, np.logical_and, np.minimum and np.maximum"
        )
    if isinstance(error, SyntaxError):
        return f"{text.split(' (')[0]} ({error.filename}, line {error.lineno})"
    place = own_place(error)
    if place or isinstance(error, ModuleNotFoundError):
        return f"{text} ({place})" if place else text
    frames = traceback.extract_tb(error.__traceback__)
    outside = [f for f in frames if not f.filename.startswith("<") and f.filename != __file__]
    return f"{text} ({outside[-1].filename}, line {outside[-1].lineno})" if outside else text


_ROOT = Path(__file__).resolve().parent
_NOT_OWN = (
    str(_ROOT),
    str(_ROOT.parent / "controllers"),
    *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")),
    sys.exec_prefix,
    "<",
)


def own_modules() -> dict[str, str]:
    """Return the files of imported modules that are the user's own, by the module's name."""
    files = {name: getattr(module, "__file__", None) for name, module in sys.modules.copy().items()}
    return {name: f for name, f in files.items() if f and not f.startswith(_NOT_OWN)}


def own_place(error: BaseException) -> str:
    """Return file and line of the user's own code that an error passed last; empty if none did."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if not f.filename.startswith(_NOT_OWN)]
    if not own:
        return ""
    file = Path(own[-1].filename)
    shown = file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file
    return f"{shown}, line {own[-1].lineno}"


def _plain(name: str) -> str:
    return name.replace("-", "_").lower()


def _modules(package: str) -> Iterator[ModuleType]:
    root = importlib.import_module(package)
    yield root
    for found in pkgutil.walk_packages(getattr(root, "__path__", ()), f"{package}."):
        if not found.name.rpartition(".")[2].startswith("__"):
            yield importlib.import_module(found.name)


def _import(name: str, folder: Path | None) -> ModuleType:
    known = sys.modules.get(name)
    if known is not None and folder is not None:
        # A module of the same name from another folder must not answer for this one.
        file = getattr(known, "__file__", None)
        here = folder / Path(*name.split("."))
        ours = {here.with_suffix(".py").resolve(), (here / "__init__.py").resolve()}
        if file is not None and any(p.exists() for p in ours) and Path(file).resolve() not in ours:
            del sys.modules[name]
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        # What it imports in turn is another mistake.
        if not f"{name}.".startswith(f"{error.name}."):
            raise
        raise WorkbenchError(
            f"there is no module {name!r} in {folder or Path.cwd()} or on the Python path;"
            " 'mine:thing' is what the file mine.py calls thing"
        ) from None


@contextmanager
def _searched(folder: Path | None) -> Iterator[None]:
    """Search a folder before all others, and after all others what its functions import later."""
    if folder is None:
        yield
        return
    path = str(folder.resolve())
    sys.path.insert(0, path)
    try:
        yield
    finally:
        sys.path.remove(path)
        if path not in sys.path:
            sys.path.append(path)
