"""A checker of signatures: no public callable swallows a keyword that it does not know."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

BOGUS = "no_such_keyword"


def callables(module: ModuleType) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield the public functions, classes and methods that a module defines, with their names."""
    for name, item in vars(module).items():
        if name.startswith("_") or getattr(item, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(item):
            if not issubclass(item, BaseException):
                yield name, item
            for method in vars(item):
                found = inspect.getattr_static(item, method)
                function = getattr(found, "__func__", found)
                if not method.startswith("_") and inspect.isfunction(function):
                    yield f"{name}.{method}", function
        elif inspect.isfunction(item) or hasattr(item, "__wrapped__"):
            yield name, item


def is_constructible(item: Callable[..., Any]) -> bool:
    """Tell whether calling the item reaches a constructor or function of its own."""
    if not inspect.isclass(item):
        return True
    abstract = getattr(item, "_is_protocol", False) or inspect.isabstract(item)
    return not abstract and not issubclass(item, enum.Enum)


def check_callable(item: Callable[..., Any]) -> str | None:
    """Return how a callable swallows an unknown keyword, or None if it refuses it."""
    if not is_constructible(item):
        return None
    for parameter in inspect.signature(item).parameters.values():
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            return f"takes **{parameter.name}"
    try:
        item(**{BOGUS: 1})
    except TypeError as error:
        refused = "keyword" in str(error) or "takes no arguments" in str(error)
        return None if refused else f"answers an unknown keyword with: {error}"
    except Exception as error:  # noqa: BLE001 -- Any answer but a TypeError is a finding.
        return f"answers an unknown keyword with {type(error).__name__}: {error}"
    return "accepts an unknown keyword"


def check_module(module: ModuleType) -> list[str]:
    """Return the public callables of a module that swallow unknown keywords, and how."""
    found = [(name, check_callable(item)) for name, item in callables(module)]
    return [f"{name} {problem}" for name, problem in found if problem]
