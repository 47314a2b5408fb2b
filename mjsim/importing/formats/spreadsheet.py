"""Spreadsheets (``.xlsx``) through openpyxl: the first sheet that holds a table of numbers.

A sheet becomes lines of text with tabs, and is read as any other table: several header lines, units, columns of text,
dates and times.
"""

from __future__ import annotations

import io
import zipfile
from datetime import date, datetime, time, timedelta
from pathlib import Path

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table, table_of
from mjsim.io.inputs import check_rows, read_bytes

#: Largest size of the unpacked file, bytes.
_LARGEST = 1_000_000_000


@register
class Spreadsheet(Format):
    """A workbook of Excel 2007 or later (.xlsx), with a table of numbers below its header."""

    suffixes = (".xlsx", ".xlsm")
    heeds = ("rows",)

    def read(self, path: Path, options: Options) -> Table:
        data = read_bytes(path)
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as packed:
                size = sum(f.file_size for f in packed.infolist())
        except zipfile.BadZipFile:
            raise InputError(f"{path}: no workbook; allowed: {self.__doc__}") from None
        if size > _LARGEST:
            raise InputError(f"{path}: {size / 1e6:.0f} MB unpacked; allowed: up to {_LARGEST / 1e6:.0f} MB")
        from openpyxl import load_workbook  # slow to load

        book = load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        refused = None
        for sheet in book.worksheets:
            lines = ["\t".join(map(_text, row)) for row in sheet.iter_rows(values_only=True)]
            check_rows(path, len(lines))
            try:
                note = f"sheet {sheet.title!r}" + (f" of {len(book.worksheets)}" if len(book.worksheets) > 1 else "")
                return table_of(path, lines, [note], "tab", "point", options.rows)
            except InputError as error:
                refused = refused or error
        raise refused or InputError(f"{path}: no sheet with cells; allowed: {self.__doc__}")


def _text(cell: object) -> str:
    """A cell as text; dates and times as ISO 8601 writes them."""
    if cell is None:
        return ""
    if isinstance(cell, datetime):
        return cell.isoformat(" ", "microseconds")
    if isinstance(cell, time):
        return cell.isoformat("microseconds")
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    if isinstance(cell, date):
        return cell.isoformat()
    return repr(cell) if isinstance(cell, float) else str(cell).replace("\t", " ").replace("\n", " ").strip()
