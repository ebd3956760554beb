"""Transfer functions as people write them: ``2 exp(-0.1 s) / (s (0.5 s + 1))``."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model.linear_system import Late, late_system

_TOKEN = re.compile(r"\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|[A-Za-z_]+|\*\*|\S)")


_TF = re.compile(r"\btf\s*\(\s*(\[[^]]*\]|[^][(),]+),\s*(\[[^]]*\]|[^][(),]+)\)")


def _quotient(found: re.Match[str]) -> str:
    """Write MATLAB's ``tf([1 3], [1 2 1])`` as a quotient of polynomials."""
    both = (re.split(r"[\s,]+", part.strip("[] ")) for part in found.groups())
    sums = (
        "+".join(f"({c})" + "*s" * (len(part) - i) for i, c in enumerate(part, 1)) for part in both
    )
    return "(({})/({}))".format(*sums)


def system_of_text(text: str) -> Any:
    """Return a transfer function, or a matrix of them, as a ``control.StateSpace``.

    Its signals are ``u`` and ``y``, or ``u_1``, ``u_2``, ... of several.

    Args:
        text: Numbers, ``s`` in rad/s, ``+ - * / ^``, brackets and ``exp(-T s)`` for a delay of T
            seconds; a product needs no sign; ``tf([1 3], [1 2 1])`` as in MATLAB. ``[a, b; c, d]``
            has a row for each output.

    Raises:
        WorkbenchError: If it is none, says where; or it differentiates, or runs ahead of time.

    Example:
        >>> system = system_of_text("2 exp(-0.1 s) / (s (0.5 s + 1))")
        >>> system.nstates, system.input_labels, system.output_labels
        (5, ['u'], ['y'])
    """
    import control as ct

    found = late_system(_Parser(text).rows(), f"transfer function {text!r}")
    names = {"inputs": _numbered("u", found.ninputs), "outputs": _numbered("y", found.noutputs)}
    named = ct.ss(found, name="linear system", **names)
    named.late, named.passing, named.delays = found.late, found.passing, found.delays
    return named


def _numbered(letter: str, count: int) -> list[str]:
    return [letter] if count == 1 else [f"{letter}_{i + 1}" for i in range(count)]


_Sum = list[Late]

_SAME = 1e-6
"""Distance of a zero from a pole, over its size, at which they are one."""


class _Parser:
    """Reads a transfer function from left to right, each level of precedence by one method."""

    def __init__(self, text: str) -> None:
        self._text = text = _TF.sub(_quotient, text)
        plain = text.replace("·", "*").replace("−", "-")
        self._tokens = [(m.group(1), m.end()) for m in _TOKEN.finditer(plain)]
        self._place = 0

    def rows(self) -> list[list[_Sum]]:
        """Return the whole: rows of entries."""
        matrix = self._taken("[")
        rows = [[self._sum()]]
        while matrix and not self._taken("]"):
            if self._taken(";"):
                rows.append([])
            elif not self._taken(","):
                raise self._wrong("a comma, a semicolon or ]")
            rows[-1].append(self._sum())
        if self._next:
            raise self._wrong("the end")
        if len({len(row) for row in rows}) > 1:
            raise WorkbenchError(
                f"the rows of {self._text!r} have {', '.join(str(len(r)) for r in rows)} entries;"
                " each output needs one for each command"
            )
        return rows

    @property
    def _next(self) -> str:
        return self._tokens[self._place][0] if self._place < len(self._tokens) else ""

    def _taken(self, *tokens: str) -> str:
        found = self._next
        if found not in tokens:
            return ""
        self._place += 1
        return found

    def _wrong(self, wanted: str) -> WorkbenchError:
        before = self._text[: self._tokens[self._place - 1][1]] if self._place else ""
        found = repr(self._next) if self._next else "its end"
        where = f" behind {before.strip()!r}" if before.strip() else ""
        return WorkbenchError(
            f"{self._text!r}: {found} stands{where} where {wanted} must be; write numbers, s,"
            " + - * / ^ ( ) and exp(-T s), such as 2 exp(-0.1 s) / (s (0.5 s + 1))"
        )

    def _sum(self) -> _Sum:
        total = self._product()
        while sign := self._taken("+", "-"):
            more = self._product()
            if sign == "-":
                more = _times([_number_of(-1.0)], more)
            total = _added(total, more)
        return total

    def _product(self) -> _Sum:
        found, divided = self._power(), False
        while True:
            sign = self._taken("*", "/")
            if not sign and not re.fullmatch(r"[\w.(]+", self._next or ")"):
                return found
            if not sign and divided:
                raise WorkbenchError(
                    f"{self._text!r}: is {self._next!r} divided by as well? Write 1/(2 s) or"
                    " (1/2) s"
                )
            factor = self._power()
            # A bracket ends what is divided by.
            divided = sign == "/" and self._tokens[self._place - 1][0] != ")"
            factor = self._turned(factor) if sign == "/" else factor
            for a, b in ((a, b) for a in found for b in factor):
                self._keeps_growing(a.num, b.den)
                self._keeps_growing(b.num, a.den)
            found = _times(found, factor)

    def _keeps_growing(self, num: Vector, den: Vector) -> None:
        """Refuse to divide out what grows: it would still do so, and nothing would show it."""
        zeros, poles = np.roots(num), np.roots(den)
        for pole in poles[poles.real > _SAME * np.abs(poles)]:
            if np.any(np.abs(zeros - pole) < _SAME * abs(pole)):
                told = f"{pole:.4g}" if pole.imag else f"{pole.real:.4g}"
                raise WorkbenchError(
                    f"{self._text!r} divides out s = {told} rad/s, which grows by itself: the plant"
                    " would run away inside while its output rests, and no controller could hold"
                    " it; give a zero beside the pole, or what is left without both"
                )

    def _turned(self, factor: _Sum) -> _Sum:
        """Return one over a factor."""
        if len(factor) > 1 or factor[0].delay:
            raise WorkbenchError(
                f"{self._text!r} divides by what is late; a loop around a delay is no"
                " transfer function to design for: give the plant inside the loop"
            )
        if not factor[0].num.any():
            raise WorkbenchError(f"{self._text!r} divides by zero")
        return [Late(factor[0].den, factor[0].num)]

    def _power(self) -> _Sum:
        if sign := self._taken("-", "+"):
            return _times([_number_of(-1.0 if sign == "-" else 1.0)], self._power())
        base = self._factor()
        if not self._taken("^", "**"):
            return base
        if not re.fullmatch(r"\d+", self._next):
            raise self._wrong("a whole exponent")
        found = [_number_of(1.0)]
        for _ in range(int(self._taken(self._next))):
            found = _times(found, base)
        return found

    def _factor(self) -> _Sum:
        token = self._next
        if self._taken("("):
            return self._closed()
        if self._taken("s"):
            return [Late(np.array([1.0, 0.0]), np.ones(1))]
        if re.fullmatch(r"[\d.].*", token):
            self._place += 1
            return [_number_of(float(token))]
        exponential = self._taken("exp") or (self._taken("e") and self._taken("^", "**"))
        if not exponential:
            raise self._wrong("a number, s, exp or (")
        if not self._taken("("):
            raise self._wrong("( and the exponent")
        (inside, *more) = self._closed()
        slope, rest = np.polydiv(inside.num, inside.den)
        late = -slope[0] if len(slope) == 2 and not slope[1] else 0.0
        if more or inside.delay or rest.any() or not late > 0.0:
            raise WorkbenchError(
                f"{self._text!r}: a delay is exp(-T s) with T above 0 s, such as exp(-0.1 s)"
            )
        return [Late(np.ones(1), np.ones(1), float(late))]

    def _closed(self) -> _Sum:
        found = self._sum()
        if not self._taken(")"):
            raise self._wrong(")")
        return found


def _number_of(value: float) -> Late:
    return Late(np.array([value]), np.ones(1))


def _times(one: _Sum, other: _Sum) -> _Sum:
    return [
        Late(np.convolve(a.num, b.num), np.convolve(a.den, b.den), a.delay + b.delay)
        for a in one
        for b in other
    ]


def _added(one: _Sum, other: _Sum) -> _Sum:
    """Return a sum; what is late by as much has one denominator."""
    found = {term.delay: term for term in one}
    for term in other:
        if (known := found.get(term.delay)) is None:
            found[term.delay] = term
            continue
        a, b = np.convolve(known.num, term.den), np.convolve(term.num, known.den)
        n = max(len(a), len(b))
        num = np.pad(a, (n - len(a), 0)) + np.pad(b, (n - len(b), 0))
        found[term.delay] = Late(num, np.convolve(known.den, term.den), term.delay)
    return list(found.values())
