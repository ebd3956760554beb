"""Parts of an expression: what a parameter multiplies, and the terms that add up."""

from __future__ import annotations

import casadi as ca


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
    own, found, seen = symbol.element_hash(), list[ca.SX](), set[int]()
    waiting = [e for e in expression.elements() if not e.is_constant()]
    while waiting:
        node = waiting.pop()
        if node.is_symbolic() or node.is_constant() or node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        parts = [node.dep(i) for i in range(node.n_dep())]
        mine = [part.is_symbolic() and part.element_hash() == own for part in parts]
        if any(mine):
            product = node.op() == ca.OP_MUL and not all(mine)
            if not product and not (node.op() == ca.OP_DIV and not mine[0]):
                return None
            found.append(parts[mine.index(False)])
        waiting += [part for part, is_it in zip(parts, mine, strict=True) if not is_it]
    if not found or not all(ca.is_equal(other, found[0], 8) for other in found[1:]):
        return None
    return found[0]


def terms(expression: ca.SX) -> list[ca.SX]:
    """Return what adds up to an expression, any unit, each over what all of it is divided by.

    The difference of two bare symbols is one term: what counts is how far they are apart.

    Example:
        >>> import casadi as ca
        >>> a, k, m, p, x, y = (ca.SX.sym(n) for n in "akmpxy")
        >>> terms((a * p - k * (x - y)) / m)
        [SX(((a*p)/m)), SX((-((k*(x-y))/m)))]
    """
    parts = [expression.dep(i) for i in range(expression.n_dep())]
    op = expression.op() if parts else None
    if op == ca.OP_NEG:
        return [-part for part in terms(parts[0])]
    if op == ca.OP_DIV:
        return [part / parts[1] for part in terms(parts[0])]
    if op in (ca.OP_ADD, ca.OP_SUB) and any(part.n_dep() for part in parts):
        return [*terms(parts[0]), *terms(parts[1] if op == ca.OP_ADD else -parts[1])]
    return [expression]
