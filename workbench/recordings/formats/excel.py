"""Excel workbooks: the sheet with the most rows, read as text tables are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from workbench.recordings.columns import Columns
from workbench.recordings.formats.delimited_text import cell_text, read_cells
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.variables import taken_apart


def read_excel(path: Path, options: ReadOptions) -> Columns:
    """Read the sheet with the most rows of a workbook; formulas count with the values kept."""
    import openpyxl

    with taken_apart(path, "an Excel workbook"):
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        sheets = [[[cell_text(v) for v in row] for row in s.values] for s in book.worksheets]
        titles = [s.title for s in book.worksheets]
    rows = max(sheets, key=len, default=[])
    found = read_cells(path, rows, options)
    if len(sheets) > 1:
        note = f"read from sheet {titles[sheets.index(rows)]!r}, the longest of {len(sheets)}"
        found = replace(found, notes=(*found.notes, note))
    return found


EXCEL = Format("excel", "Excel", (".xlsx", ".xlsm"), read_excel, extra="logs")
