"""The page of all fields of a study file, written from the schema that checks it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from controllers.design import DESIGNS
from workbench.checked_json import ListShape, NamedShape, Shape
from workbench.study.fields import TABLES, FieldTable
from workbench.verification import METRICS
from workbench.verification.signals import SIGNALS

_HEAD = """# Fields of a study file

Written by `workbench study-fields` from the schema that checks every study.

A study is a TOML file. Numbers are in the unit of their column; text may carry another one: `0.02`,
`"20 ms"`, `"5 bar"`, `"30 deg"`. What has no entry under *if left out* may be missing; **needed**
fields must be there. `workbench new-study FILE` writes a commented study that runs. A study that
names `module:object` runs that code: compare only studies whose authors you trust.

A finished run is not done again while the files that it read, its modules and its packages are as
they were. What a design takes from environment variables, from names of files or from the network
is not seen: keep gains in files, or use `workbench compare --fresh`.
"""

_NAMES = {
    "plants": "PLANT",
    "variations": "VARIATION",
    "controllers": "CONTROLLER",
    "scenarios": "SCENARIO",
    "references": "OUTPUT",
    "tolerances": "METRIC",
}
"""What stands in the place of a name in the heading of a table."""


def study_fields() -> str:
    """Return the page: every field of a study, keys of designs, and metrics, as Markdown."""
    parts = [_HEAD]
    for heading, says, table in tables():
        parts.append(f"## {heading}\n\n{says}\n\n{_fields(table)}")
    parts.append(_references())
    parts.append(_designs())
    parts.append(_metrics())
    return "\n".join(parts)


def tables() -> Iterator[tuple[str, str, FieldTable]]:
    """Yield heading, meaning and shape of every table of a study file, each once."""
    top = TABLES["study"]
    waiting = [("Top of the file", "The study itself.", top)]
    seen: list[int] = []
    while waiting:
        heading, says, table = waiting.pop(0)
        if id(table) in seen:
            continue
        seen.append(id(table))
        yield heading, says, table
        inside = []
        outer = "" if table is top else heading.strip("`[]") + "."
        for key, field in table.fields.items():
            inner, several, names = _table(field.shape, key)
            if inner is not None:
                path = f"{outer}{key}{names}"
                said = f"{field.text[:1].upper()}{field.text[1:]}."
                inside.append((f"`[[{path}]]`" if several else f"`[{path}]`", said, inner))
        waiting = inside + waiting


def _table(shape: Shape, key: str) -> tuple[FieldTable | None, bool, str]:
    """Return the table that a shape holds, whether it is a list, and what names its entries."""
    if isinstance(shape, FieldTable):
        return shape, False, ""
    if isinstance(shape, ListShape):
        inner, _, names = _table(shape.item, key)
        return inner, True, names
    if isinstance(shape, NamedShape):
        inner, several, _ = _table(shape.item, key)
        return inner, several, f".{_NAMES.get(key, 'NAME')}"
    return None, False, ""


def _fields(table: FieldTable) -> str:
    rows = []
    for key, field in table.fields.items():
        unit = "" if field.unit == "1" else field.unit
        example = f"`{field.example}`" if field.example else "a table, see there"
        usual = "**needed**" if field.needed else _usual(field.usual)
        rows.append((f"`{key}`", field.text, unit, field.valid, usual, example))
    return _rows(("field", "meaning", "unit", "range", "if left out", "example"), rows)


def _usual(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _references() -> str:
    rows = [
        (f"`{name}`", *(", ".join(f"`{k}`" for k in keys) for keys in (kind.valued, kind.others)))
        for name, kind in SIGNALS.members().items()
    ]
    head = ("kind", "keys in `unit`", "keys in SI")
    return f"## Kinds of reference\n\nNames for `kind`, with their keys.\n\n{_rows(head, rows)}"


def _designs() -> str:
    parts = [
        "## Designs\n\nNames for `design`, with the keys of their `specification`. A design of your"
        " own, `module:function`, gets its specification as a mapping.\n"
    ]
    for name, design in sorted(DESIGNS.members().items()):
        rows = [(f"`{k.name}`", k.meaning, _usual(k.default)) for k in design.keys]
        in_c = "" if design.exports else " It cannot be written as C."
        parts.append(f"### `{name}`\n\n{design.summary.rstrip('.')}.{in_c}\n")
        if rows:
            parts.append(_rows(("key", "meaning", "if left out"), rows))
    return "\n".join(parts)


def _metrics() -> str:
    rows = [
        (
            f"`{name}`",
            metric.help,
            "" if metric.unit == "1" else metric.unit.replace("{unit}", "that of the output"),
        )
        for name, metric in sorted(METRICS.members().items())
    ]
    return "## Metrics\n\nNames for `metric`.\n\n" + _rows(("metric", "meaning", "SI unit"), rows)


def _rows(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(c.replace('|', r'&#124;') for c in row)} |\n" for row in lines)
