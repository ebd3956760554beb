"""Answers of a blind round: what was hidden in each case, and that it was fixed beforehand."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.checked_json import TableShape, flag, listed, named, read_json, read_toml, text
from workbench.errors import WorkbenchError, check_choice

NAMES = Path(__file__).with_name("answers.toml")
"""How the words of a key are read; see the file."""

NOTHING = "none"
"""The word of a key for a case that hides nothing."""


@dataclass(frozen=True)
class Truth:
    """One effect that a case hides.

    Args:
        library: Names of the library that say the same; none if the library does not have it.
    """

    word: str
    library: tuple[str, ...]
    groups: tuple[str, ...]
    sensor: bool

    @property
    def outside(self) -> bool:
        """Whether the library does not have it."""
        return not self.library


@dataclass(frozen=True)
class Names:
    """How the words of a key are read.

    Args:
        groups: Beginnings of port names by group.
    """

    groups: Mapping[str, tuple[str, ...]]
    effects: Mapping[str, Truth]

    def group(self, port: str) -> str:
        """Return the group of a port; the part before the dot if it belongs to none."""
        for name, starts in self.groups.items():
            if port.startswith(starts):
                return name
        first, _, what = port.partition(".")
        return f"{first} sensor" if what == "reading" else first

    def truths(self, case: str, words: list[str]) -> tuple[Truth, ...]:
        """Return what a case hides."""
        hidden = [word for word in words if word != NOTHING]
        for word in hidden:
            if word not in self.effects:
                raise WorkbenchError(
                    f"the key's effect {word!r} of case {case} has no meaning in the table of"
                    f" names; give a table with --names that says which effects of the library it"
                    f" is (known: {', '.join(sorted(self.effects))})"
                )
        return tuple(self.effects[word] for word in hidden)


def read_names(path: str | Path | None = None) -> Names:
    """Read how the words of a key are to be understood.

    Args:
        path: A TOML file whose entries come on top of those that ship; None for those alone.

    Example:
        >>> read_names().group("joint.torque"), read_names().group("axis.force")
        ('motion', 'axis')
    """
    groups: dict[str, tuple[str, ...]] = {}
    effects: dict[str, Truth] = {}
    names = Names(groups, effects)
    for file in (NAMES, *([Path(path)] if path is not None else [])):
        content = read_toml(file, "table of names", _NAMES)
        groups |= {name: tuple(starts) for name, starts in content.get("groups", {}).items()}
        for word, entry in content.get("effects", {}).items():
            effects[word] = Truth(
                word,
                tuple(entry["library"]),
                tuple(dict.fromkeys(map(names.group, entry["ports"]))),
                entry.get("sensor", False),
            )
    return names


def read_key(path: str | Path) -> dict[str, Mapping[str, Any]]:
    """Read an answer key: ``truth`` (a list of effects) by case."""
    fix = 'it needs {CASE: {"truth": [{"effect": NAME}]}}'
    content: dict[str, Mapping[str, Any]] = read_json(path, "key", _KEY, fix=fix)
    for case in content:
        if not 1 <= len(case) <= 100 or not case.isprintable() or "/" in case:
            raise WorkbenchError(
                f"key {str(path)!r} has a case {case[:60]!r}; give it the name of a folder"
            )
    return content


_KEY = named(TableShape({"truth": listed(TableShape({"effect": text}))}))


def words_of(answer: Mapping[str, Any]) -> list[str]:
    """Return the effects that an answer names."""
    return [truth["effect"] for truth in answer["truth"]]


def commitments(answer: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the SHA-256 of an answer's canonical JSON, with and without blanks.

    Returns:
        Hexadecimal digests: sorted keys with the usual separators, then compact ones.
    """
    forms = [
        json.dumps(answer, sort_keys=True, separators=separators, ensure_ascii=ascii_only)
        for ascii_only in (True, False)
        for separators in ((", ", ": "), (",", ":"))
    ]
    return tuple(
        hashlib.sha256(form.encode("utf-8", "surrogatepass")).hexdigest() for form in forms
    )


def check_commitments(key: Mapping[str, Mapping[str, Any]], path: str | Path) -> int:
    """Check that a key's answers are those committed beforehand; returns how many were checked.

    Raises:
        WorkbenchError: If the file cannot be read, or an answer was not committed or differs.
    """
    try:
        content = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise WorkbenchError(f"commitments {str(path)!r} cannot be read: {error}") from None
    lines = [line.split() for line in content.splitlines() if line.strip()]
    if any(len(words) != 2 for words in lines):
        raise WorkbenchError(
            f"commitments {str(path)!r} must hold a case and its SHA-256 on each line"
        )
    committed = dict(lines)
    for case, answer in key.items():
        check_choice("committed case", case, committed)
        if committed[case].lower() not in commitments(answer):
            raise WorkbenchError(
                f"the answer of case {case} is not the one committed beforehand; the round cannot"
                " be scored with this key"
            )
    return len(key)


_EFFECT = TableShape({"library": listed(text), "ports": listed(text)}, {"sensor": flag})
_NAMES = TableShape({}, {"groups": named(listed(text)), "effects": named(_EFFECT)})
