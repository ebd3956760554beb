"""Expressions taken apart: what a parameter multiplies, the terms that add up, roots kept real."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np

from workbench.arrays import Vector


def cofactor(expression: ca.SX, symbol: ca.SX) -> ca.SX | None:
    """Find what a symbol multiplies or divides in an expression, any unit; None unless it is one.

    Example:
        >>> import casadi as ca
        >>> k, x, y = (ca.SX.sym(n) for n in "kxy")
        >>> cofactor(2.0 + k * (x - y), k), cofactor((x + y) / k, k)
        (SX((x-y)), SX((x+y)))
        >>> cofactor(k * x + k**2, k) is None
        True
    """
    own, found = symbol.element_hash(), list[ca.SX]()
    for node in _operations(expression):
        parts = [node.dep(i) for i in range(node.n_dep())]
        mine = [part.is_symbolic() and part.element_hash() == own for part in parts]
        if any(mine):
            product = node.op() == ca.OP_MUL and not all(mine)
            if not product and not (node.op() == ca.OP_DIV and not mine[0]):
                return None
            found.append(parts[mine.index(False)])
    if not found or not all(ca.is_equal(other, found[0], 8) for other in found[1:]):
        return None
    return found[0]


def terms(expression: ca.SX) -> list[ca.SX]:
    """Return what adds up to an expression, any unit, each times what all of it is multiplied by.

    The difference of two bare symbols is one term: what counts is how far they are apart.

    Example:
        >>> import casadi as ca
        >>> a, k, m, p, x, y = (ca.SX.sym(n) for n in "akmpxy")
        >>> terms((a * p - k * (x - y)) / m)
        [SX(((a*p)/m)), SX((-((k*(x-y))/m)))]
        >>> terms(k * (a * p - x))
        [SX((k*(a*p))), SX((-(k*x)))]
    """
    parts = [expression.dep(i) for i in range(expression.n_dep())]
    op = expression.op() if parts else None
    if op == ca.OP_NEG:
        return [-part for part in terms(parts[0])]
    if op == ca.OP_DIV:
        return [part / parts[1] for part in terms(parts[0])]
    if op == ca.OP_MUL:
        first, second = (terms(part) for part in parts)
        if min(len(first), len(second)) == 1 < max(len(first), len(second)):
            return [a * b for a in first for b in second]
    if op in (ca.OP_ADD, ca.OP_SUB) and any(part.n_dep() for part in parts):
        return [*terms(parts[0]), *terms(parts[1] if op == ca.OP_ADD else -parts[1])]
    return [expression]


_REVERSING = {
    ca.OP_TANH, ca.OP_SIGN, ca.OP_ATAN, ca.OP_ERF, ca.OP_IF_ELSE_ZERO, ca.OP_SQRT, ca.OP_FMIN,
    ca.OP_FMAX,
}  # fmt: skip


def reverses_over(expression: ca.SX, signal: ca.SX) -> bool:
    """Tell whether a part of an expression, any unit, reverses with a signal, as dry friction does.

    Example:
        >>> v = ca.SX.sym("v")
        >>> reverses_over(2.0 * v + 3.0 * ca.tanh(v / 1e-3), v), reverses_over(v * ca.fabs(v), v)
        (True, False)
        >>> reverses_over(v / (ca.fabs(v) + 1e-3), v)
        True
    """
    for node in _operations(expression):
        # v / (|v| + e) is a rounded sign.
        below = _operations(node.dep(1)) if node.op() == ca.OP_DIV else ()
        rounded = any(part.op() == ca.OP_FABS for part in below)
        if (rounded or node.op() in _REVERSING) and ca.depends_on(node, signal):
            return True
    return False


def _operations(expression: ca.SX) -> Iterator[ca.SX]:
    """Yield all that is computed on the way to an expression, each once."""
    waiting, seen = expression.elements(), set[int]()
    while waiting:
        node = waiting.pop()
        if node.n_dep() and node.element_hash() not in seen:
            seen.add(node.element_hash())
            waiting += [node.dep(i) for i in range(node.n_dep())]
            yield node


def weight(expression: ca.SX, signals: ca.SX) -> ca.SX | None:
    """Find what a sum of signals is divided by as a whole, any unit, if that is no constant.

    Such is the inertia of a machine that depends on where it is, the area of a tank that widens,
    the volume of a vessel; None if there is none.

    Args:
        expression: What a port carries or a rate is, any unit.
        signals: States and inputs, a column vector, in SI.

    Example:
        >>> t, m, r, w = (ca.SX.sym(n) for n in "tmrw")
        >>> weight((t - w) / (m * r), ca.vertcat(t, r, w)), weight(t / r, ca.vertcat(t, r))
        (SX(r), None)
    """
    sums, divisors = [], []
    waiting = [(expression, True)]
    while waiting:
        node, above = waiting.pop()
        op = node.op() if node.n_dep() else None
        if op in (ca.OP_NEG, ca.OP_MUL, ca.OP_DIV):
            waiting.append((node.dep(0), above))
            if op != ca.OP_NEG:
                waiting.append((node.dep(1), above == (op == ca.OP_MUL)))
        elif not above:
            divisors.append(node)
        elif op in (ca.OP_ADD, ca.OP_SUB):
            sums.append(node)
    found = [node for node in divisors if ca.depends_on(node, signals)]
    if not found or not any(ca.depends_on(node, signals) for node in sums):
        return None
    return math.prod(found, start=ca.SX(1.0))


_LOOKS = 32


def leave_the_numbers(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], x: Vector, reach: Vector, *rest: Vector
) -> bool:
    """Tell whether expressions with roots have no value, or no slope, at some usual states.

    The root of what is cut off at zero, as of a level that is not negative, has a value there, but
    an infinite slope times none.

    Args:
        expressions: Rates and measurements, any shapes, in SI.
        symbols: States, inputs and parameters, column vectors, in SI.
        x: Usual states, shape (n_states,), in SI.
        reach: How far they may go from there, shape (n_states,), in SI.
        rest: Usual inputs and parameters, in SI.
    """
    others = _others(expressions, symbols)
    f = ca.Function("looked_at", [*symbols, others], expressions)
    roots = (ca.OP_SQRT, ca.OP_POW, ca.OP_CONSTPOW)
    if not any(f.instruction_id(k) in roots for k in range(f.n_instructions())):
        return False
    slopes = [ca.jacobian(e, symbols[0]) for e in expressions]
    f = ca.Function("looked_at", [*symbols, others], [*expressions, *slopes])
    away = np.random.default_rng(3).uniform(-1.0, 1.0, (_LOOKS, len(x))) * reach
    seen = f.call([(x + away).T, *(np.asarray(r) for r in rest), np.zeros(others.numel())])
    return not all(np.isfinite(np.asarray(part, dtype=float)).all() for part in seen)


def with_real_roots(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Return expressions, in SI, in which the root of what is negative is zero.

    Args:
        expressions: Rates and measurements, any shapes, in SI; so is what returns.

    Example:
        >>> h = ca.SX.sym("h")
        >>> (flow,) = with_real_roots([3.0 * ca.sqrt(h)])
        >>> f = ca.Function("f", [h], [flow, ca.jacobian(flow, h)])
        >>> [float(q) for q in (*f(4.0), *f(-4.0))]
        [6.0, 0.75, 0.0, 0.0]
    """

    def real(op: int, of: Sequence[ca.SX], value: ca.SX) -> ca.SX:
        power = of[1] if len(of) > 1 else None
        whole = power is not None and power.is_constant() and float(power) % 1.0 == 0.0
        root = op == ca.OP_SQRT or (op in (ca.OP_POW, ca.OP_CONSTPOW) and not whole)
        return ca.if_else(of[0] > 0.0, value, 0.0) if root else value

    return _rewritten(expressions, real)


def with_rounded_signs(expression: ca.SX, x: ca.SX, width: float) -> ca.SX:
    """Return an expression in which no sign of what states move jumps.

    Args:
        expression: Rates, any shape, dimensionless over the scales of the states, per s.
        x: States, a column vector, dimensionless over their scales.
        width: Changes of the states within which a sign goes over, dimensionless.

    Returns:
        The same, per s.

    Example:
        >>> v = ca.SX.sym("v")
        >>> f = ca.Function("f", [v], [with_rounded_signs(ca.sign(v), v, 1e-3)])
        >>> [round(float(f(q)), 3) for q in (-0.1, 0.0, 0.001, 0.1)]
        [-1.0, 0.0, 0.762, 1.0]
    """

    def rounded(op: int, of: Sequence[ca.SX], value: ca.SX) -> ca.SX:
        at = of[-1]
        if op not in (ca.OP_SIGN, ca.OP_COPYSIGN) or not ca.depends_on(at, x):
            return value
        size = ca.fabs(of[0]) if op == ca.OP_COPYSIGN else 1.0
        return size * ca.tanh(at / (width * ca.sum2(ca.fabs(ca.jacobian(at, x))) + 1e-300))

    return _rewritten([expression], rounded)[0]


def _rewritten(
    expressions: Sequence[ca.SX], written: Callable[[int, Sequence[ca.SX], ca.SX], ca.SX]
) -> list[ca.SX]:
    """Return expressions whose operations, their arguments and values are written anew."""
    symbols = _others(expressions, ())
    f = ca.Function("written", [symbols], expressions)
    work: dict[int, ca.SX] = {}
    found = [[ca.SX(0)] * e.nnz() for e in expressions]
    for k in range(f.n_instructions()):
        op, given, to = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_OUTPUT:
            found[to[0]][to[1]] = work[given[0]]
        elif op == ca.OP_INPUT:
            work[to[0]] = symbols[given[1]]
        elif op == ca.OP_CONST:
            work[to[0]] = ca.SX(f.instruction_constant(k))
        else:
            of = [work[i] for i in given]
            value = ca.SX.unary(op, of[0]) if len(of) == 1 else ca.SX.binary(op, *of)
            work[to[0]] = written(op, of, value)
    return [
        ca.SX(e.sparsity(), ca.vertcat(*nonzeros)) if nonzeros else e
        for e, nonzeros in zip(expressions, found, strict=True)
    ]


def _others(expressions: Sequence[ca.SX], symbols: Sequence[ca.SX]) -> ca.SX:
    known = {part.element_hash() for vector in symbols for part in ca.vertsplit(vector)}
    found = ca.symvar(ca.veccat(*expressions))
    return ca.vcat([q for q in found if q.element_hash() not in known] or [ca.SX(0, 1)])
