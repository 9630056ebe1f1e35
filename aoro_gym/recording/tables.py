"""Tables as loggers, spreadsheets and scanners write them: CSV of any dialect, text in columns, Parquet.

>>> table = read_table(path)  # doctest: +SKIP
>>> table.numbers("pressure_a_bar")  # doctest: +SKIP

Only columns that are asked for are turned into numbers; :attr:`Table.unread` names the others.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording.units import Unit, find_unit

SAMPLE = 1 << 16
"""Bytes at the begin of a file that tell its dialect."""
SAMPLE_LINES = 200
"""Lines that tell it, at most; at least a tenth of them, however long they are."""
LARGEST_FILE = 1 << 28
"""Bytes of a text file that is read as a table."""
MOST_COLUMNS = 100_000
"""Columns of a table."""
MOST_CELLS = 50_000_000
"""Cells of a table."""
THOUSANDS = re.compile(
    r"(?<![\d.,])\d{1,3}(?:(?:,\d{3})+\.\d|(?:\.\d{3})+,\d|(?:['’\u00a0\u202f]\d{3})+)\d*(?:[.,]\d+)?"
)
"""Numbers with separators of thousands; nobody can tell them from two numbers for sure, so they are not read."""
LONGEST_ECHO = 40
"""Characters of a cell, or a name, that a message repeats."""
LARGEST_TIME = 1e11
"""Seconds (3,200 years) beyond which a clock is not in the unit that its name says."""

COMMENTS = ("#", "//", "%")
"""What a comment line begins with; the last one before the rows may hold the header."""

_SEPARATORS: tuple[str | None, ...] = ("\t", ";", "|", ",", None)
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,6})?")
_EITHER_NUMBER = re.compile(r"[+\-−]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][+-]?[0-9]{1,6})?|[+-]?(?:nan|inf)", re.I)
_INTEGER = re.compile(r"[+-]?[0-9]{1,40}")
_PLAIN = re.compile(r"[0-9eE+\-.\s]*")
_MISSING = {"", "na", "n/a", "nan", "null", "none", "-", "--", "#n/a"}


@dataclass(frozen=True)
class Dialect:
    """How a text file holds its table."""

    encoding: str = "utf-8"
    separator: str | None = ","
    """Between cells; None: blanks."""
    decimal: str = "."
    names: tuple[str, ...] = ()
    """The header, with the units of a unit line in brackets; none without a header."""
    columns: int = 0
    """Cells of a usual row."""
    skip: int = 0
    """Lines of the file before the first row."""
    count: int | None = None
    """Number of rows that a line before them declares."""
    is_header_comment: bool = False
    """Whether the names stand in a comment, so that they may be none."""
    passed_over: int = 0
    """Lines of words before the header."""


def sniff(sample: bytes, *, is_whole: bool = True) -> Dialect:
    """The dialect of a file that begins with ``sample``.

    Args:
        sample: :data:`SAMPLE` bytes or more; the whole file if it is shorter.
        is_whole: Whether that is all; a last line that is cut is left out otherwise.

    Raises:
        ValueError: the sample is no text.
    """
    encoding = find_encoding(sample)
    text = io.IncrementalNewlineDecoder(None, translate=True).decode(_decoded(sample, encoding, is_whole))
    return _find_dialect(text if is_whole else text[: text.rfind("\n") + 1] or text, encoding)


def sniff_file(path: Path) -> Dialect:
    """The dialect of the text file ``path``, by its first :data:`SAMPLE` bytes; ``ValueError`` if it is no text."""
    with path.open("rb") as stream:
        sample = stream.read(SAMPLE + 1)
    try:
        return sniff(sample[:SAMPLE], is_whole=len(sample) <= SAMPLE)
    except ValueError as error:
        raise ValueError(f"{path} {error}") from None


def find_encoding(sample: bytes) -> str:
    """Encoding of a text: by its byte order mark, UTF-8 if it can be, else Windows-1252."""
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if sample.startswith(mark):
            return encoding
    if b"\0" in sample:
        zeros = np.flatnonzero(np.frombuffer(sample, dtype=np.uint8) == 0)
        if len(zeros) > len(sample) // 4 and len(np.unique(zeros % 2)) == 1:
            return "utf-16-le" if zeros[0] % 2 else "utf-16-be"
        raise ValueError(f"is not a text file: byte {zeros[0] + 1:,} is zero")
    try:
        _decoded(sample, "utf-8", False)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _decoded(data: bytes, encoding: str, is_whole: bool) -> str:
    import codecs

    text = codecs.getincrementaldecoder(encoding)().decode(data, final=is_whole)
    if control := re.search(r"[\x00-\x08\x0e-\x19\x1b-\x1f\x7f]", text):
        line = text.count("\n", 0, control.start()) + 1
        raise ValueError(f"is not a text file: line {line} holds the control character {control[0]!r}")
    return text.rstrip("\x1a")  # DOS's end of a file


def is_number(cell: str) -> bool:
    """Whether ``cell`` is a number with a decimal point or comma, NaN and infinity included."""
    return _EITHER_NUMBER.fullmatch(cell.strip()) is not None


def parse_number(cell: str, decimal: str = ".") -> float | None:
    """The number in ``cell``; None if it is none (1_0, 0x10, two marks), not finite or too large for a float."""
    text = cell.strip().replace("−", "-")
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if np.isfinite(value) else None


def shown(text: str) -> str:
    """``text`` quoted for a message, not longer than :data:`LONGEST_ECHO`."""
    text = text.strip()
    return repr(text if len(text) <= LONGEST_ECHO else text[: LONGEST_ECHO - 1] + "…")


def listed(names: Sequence[str], limit: int = 120) -> str:
    """``names`` for a message, in ``limit`` characters; more are counted."""
    text = ""
    for index, name in enumerate(names):
        name = name if len(name) <= LONGEST_ECHO else name[: LONGEST_ECHO - 1] + "…"
        if len(text) + len(name) > limit:
            return f"{text}, … ({len(names):,} in all)" if index else f"{name} … ({len(names):,} in all)"
        text += f", {name}" if index else name
    return text


# ------------------------------------------------------------------------------------------------------------- dialect


@dataclass(frozen=True)
class _Record:
    """A line of cells: where it begins and ends."""

    first: int
    last: int
    cells: list[str]

    @cached_property
    def numbers(self) -> int:
        """Cells that are numbers or times."""
        return sum(1 for cell in self.cells if is_number(cell) or _stamp(cell) is not None)

    @cached_property
    def filled(self) -> int:
        return sum(1 for cell in self.cells if cell.strip())


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _records(
    lines: Iterable[str], separator: str | None, *, before: int = 0, is_whole: bool = True
) -> Iterator[_Record]:
    """Lines with cells, after ``before`` others; comments and blank lines are passed over.

    Raises:
        ValueError: a quotation mark is not closed.
    """
    if separator is None:
        for number, line in enumerate(lines, before + 1):
            if not _is_comment(line) and (cells := line.split()):
                yield _Record(number, number, cells)
        return
    bare = ("\n" if _is_comment(line) else line for line in lines)
    reader = csv.reader(bare, delimiter=separator, skipinitialspace=True, strict=True)
    last = 0
    try:
        for cells in reader:
            if any(map(str.strip, cells)):
                yield _Record(before + last + 1, before + reader.line_num, cells)
            last = reader.line_num
    except csv.Error as error:
        if is_whole:
            what = "a quotation mark is not closed" if "end of data" in str(error) else str(error)
            raise ValueError(f"line {before + last + 1}: {what}") from None


def _find_dialect(text: str, encoding: str) -> Dialect:
    """The dialect of ``text``, by the separator under which most cells of lines of one length are numbers."""
    lines = _first_lines(text)
    forced = re.fullmatch(r'"?sep=(.)"?', lines[0].strip()) if lines else None
    best: tuple[tuple[bool, float, int], Dialect] | None = None
    for rank, separator in enumerate([forced[1]] if forced else _SEPARATORS):
        records = list(_records(lines, separator, is_whole=False))
        if forced:
            records = [record for record in records if record.first > 1]
        usual = _usual(records)
        if usual < 2 and not forced:
            continue
        rows = [record for record in records if _width(record, usual) == usual and record.numbers]
        filled = sum(record.filled for record in rows)
        share = sum(record.numbers for record in rows) / filled if filled else 0.0
        dialect = _layout(lines, records, usual, separator, encoding)
        fits = not dialect.names or len(dialect.names) == usual
        score = (fits, share * len(rows) / max(len(records), 1), -rank)
        if best is None or score > best[0]:
            best = (score, dialect)
    if best is None:
        return _layout(lines, list(_records(lines, ",", is_whole=False)), 1, ",", encoding)
    return best[1]


def _first_lines(text: str) -> list[str]:
    """The first lines: :data:`SAMPLE` characters or a tenth of :data:`SAMPLE_LINES`, whichever is more."""
    kept, size = [], 0
    for line in itertools.islice(io.StringIO(text), SAMPLE_LINES):
        if size > SAMPLE and len(kept) > SAMPLE_LINES // 10:
            break
        kept.append(line)
        size += len(line)
    return kept


def _usual(records: list[_Record]) -> int:
    """Cells that most lines have, a last one that is always blank left out."""
    if not records:
        return 0
    (most, _), *_ = Counter(len(record.cells) for record in records).most_common(1)
    alike = [record.cells for record in records if len(record.cells) == most]
    usual = most
    while usual > 1 and not any(cells[usual - 1].strip() for cells in alike):
        usual -= 1
    return usual


def _width(record: _Record, usual: int) -> int:
    """Cells of a line, blank ones beyond the usual ones left out."""
    return usual if len(record.cells) > usual and not any(map(str.strip, record.cells[usual:])) else len(record.cells)


def _is_unit_line(record: _Record) -> bool:
    """Whether at least half of a line's cells are units, and none is another number than 1."""
    cells = [cell.strip() for cell in record.cells if cell.strip()]
    if not cells or is_number(cells[0]) or any(is_number(cell) and cell != "1" for cell in cells):
        return False
    from aoro_gym.recording.units import DIMENSIONS

    known = sum(1 for cell in cells if find_unit(cell.strip("[](){} "), *DIMENSIONS) is not None)
    return 2 * known >= len(cells)


def _layout(lines: list[str], records: list[_Record], usual: int, separator: str | None, encoding: str) -> Dialect:
    """Header, unit line, count and first row under a separator."""
    count = None
    texts: list[int] = []
    first_data = len(records)
    for index, record in enumerate(records):
        if usual >= 2 and len(record.cells) == 1 and _INTEGER.fullmatch(record.cells[0].strip()):
            count = int(record.cells[0])
        elif texts and _width(records[texts[-1]], usual) == usual and _is_unit_line(record):
            continue
        elif not record.numbers:
            texts.append(index)
        elif _width(record, usual) == usual:
            first_data = index
            break
    header = _header(records, texts, usual) if first_data < len(records) else texts[0] if texts else None
    units: list[str] = []
    start = 0 if header is None else header + 1
    while start < first_data and (  # what may stand between the header and the rows
        (len(records[start].cells) == 1 and usual >= 2 and count is not None) or _is_unit_line(records[start])
    ):
        if _is_unit_line(records[start]):
            units = [cell.strip().strip("[](){} ") for cell in records[start].cells]
        start += 1
    skip = records[start - 1].last if start else 0
    names: list[str] = []
    is_comment = False
    if header is not None:
        names = [cell.strip() for cell in records[header].cells]
    else:
        before = records[start].first - 1 if start < len(records) else len(lines)
        names = _header_in_comment(lines[:before], separator, usual)
        is_comment = bool(names)
    while names and not names[-1]:
        names.pop()
    names = [
        f"{name} [{unit}]" if unit and name else name
        for name, unit in itertools.zip_longest(names, units, fillvalue="")
    ]
    rows = [record for record in records[start:] if _width(record, usual) == usual]
    return Dialect(
        encoding, separator, _decimal(cell for row in rows for cell in row.cells), tuple(names), usual, skip, count,
        is_comment, sum(1 for index in texts if header is not None and index < header),
    )  # fmt: skip


def _header(records: list[_Record], texts: list[int], usual: int) -> int | None:
    """The last line of words before the rows, best one that has a word for every cell."""
    whole = [index for index in texts if records[index].filled >= usual == _width(records[index], usual)]
    return max(whole or texts, default=None)


def _header_in_comment(lines: list[str], separator: str | None, usual: int) -> list[str]:
    """Names of the last comment line that has as many words, none of them a number, as a row has cells."""
    for line in reversed(lines):
        if not _is_comment(line):
            continue
        bare = re.sub(r"^(#+|//+|%+)", "", line.strip()).strip()
        cells = bare.split() if separator is None else [cell.strip() for cell in bare.split(separator)]
        while cells and not cells[-1]:
            cells.pop()
        if len(cells) == usual >= 2 and not any(is_number(cell) for cell in cells):
            return [cell.strip('"') for cell in cells]
    return []


def _decimal(cells: Iterable[str]) -> str:
    marks = Counter("," if "," in cell else "." for cell in cells if ("," in cell or "." in cell) and is_number(cell))
    return "," if marks[","] > marks["."] else "."


# ---------------------------------------------------------------------------------------------------------------- rows


def number_rows(
    lines: Sequence[str], dialect: Dialect, columns: Sequence[int], *, where: str = "", first_line: int = 1
) -> NDArray[np.float64]:
    """Numbers (N, C) of the ``columns`` of whole ``lines``; fast. Blank cells and NaN are NaN; comments are passed over.

    Args:
        lines: Of the file, from a row on.
        dialect: Of the file.
        columns: Indices (C,) of the columns to read.
        where: File, for messages.
        first_line: Line of the file, from 1, that ``lines`` begins with.

    Raises:
        ValueError: names file, line and cell that is no number, or the line that has too few.
    """
    kept = [line for line in lines if line.strip() and not _is_comment(line)]
    if not kept:
        return np.zeros((0, len(columns)))
    plain = kept if dialect.decimal == "." else [line.replace(".", "?").replace(",", ".") for line in kept]
    try:
        return np.loadtxt(
            plain, delimiter=dialect.separator, usecols=tuple(columns), ndmin=2, comments=None, quotechar='"'
        )
    except ValueError:
        pass
    rows = []
    for record in _records(lines, dialect.separator, before=first_line - 1):
        line = record.first
        if len(record.cells) <= max(columns):
            raise ValueError(
                f"{where}, line {line}: {len(record.cells)} values where a row has {max(columns) + 1} or more"
            )
        row = []
        for column in columns:
            cell = record.cells[column]
            value = parse_number(cell, dialect.decimal)
            if value is None and cell.strip().lower() not in _MISSING:
                raise ValueError(f"{where}, line {line}: {shown(cell)} in column {column + 1} is not a number")
            row.append(np.nan if value is None else value)
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns))


class _Source(Protocol):
    """Cells of a table by the index of their column."""

    def texts(self, indices: Sequence[int]) -> list[list[str]] | None:
        """Cells as text; None if they have types."""
        ...

    def typed(self, index: int) -> Any:
        """A pyarrow array."""
        ...


@dataclass(frozen=True)
class Table:
    """A file's table. Columns are read when they are asked for."""

    path: Path
    names: tuple[str, ...]
    """As the header has them, a unit line's units in brackets."""
    lines: NDArray[np.int64]
    """Line of the file that each row stands on, from 1; for Parquet the row's number."""
    dialect: Dialect
    is_cut: bool
    """Whether the file ends within a line."""
    _source: _Source
    _used: set[int] = field(default_factory=set)
    _numbers: dict[int, NDArray[np.float64]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, name: object) -> bool:
        return name in self._indices

    @property
    def _indices(self) -> dict[str, list[int]]:
        if "by_name" not in self.__dict__:
            found: dict[str, list[int]] = {}
            for index, name in enumerate(self.names):
                found.setdefault(name, []).append(index)
            self.__dict__["by_name"] = found
        return self.__dict__["by_name"]

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of the columns that nobody asked for, in the file's order; those without a name by their position."""
        return tuple(name or f"column {index + 1}" for index, name in enumerate(self.names) if index not in self._used)

    def where(self, row: int) -> str:
        """File and line of a row, for messages."""
        return f"{self.path}, line {self.lines[row]}"

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.numbers(name)

    def without_last_row(self) -> Table:
        """The same table less its last row, in which its file may have been cut."""
        return Table(self.path, self.names, self.lines[:-1], self.dialect, False, self._source)

    def index(self, name: str) -> int:
        """Column called ``name``; ``ValueError`` if there is none, or two."""
        found = self._indices.get(name)
        if not found:
            raise ValueError(f"{self.path} has no column {shown(name)}, only {listed(self.names)}")
        if len(found) > 1:
            raise ValueError(f"{self.path}: the header names the column {shown(name)} twice")
        return found[0]

    def numbers_or_blank(self, name: str) -> NDArray[np.float64]:
        """Values of the column ``name``, NaN where it is blank or says that there is none; raises as :meth:`numbers`."""
        index = self.index(name)
        self._used.add(index)
        texts = self._source.texts([index])
        if texts is None:
            return self._typed_numbers(name, self._source.typed(index))
        values = np.full(len(self), np.nan)
        for row, cell in enumerate(texts[0]):
            if cell.strip().lower() in _MISSING:
                continue
            value = parse_number(cell, self.dialect.decimal)
            if value is None:
                raise ValueError(self._not_a_number(name, row, cell, 0))
            values[row] = value
        return values

    def numbers(self, name: str) -> NDArray[np.float64]:
        """Values of the column ``name``: numbers, all of them finite.

        Raises:
            ValueError: names file, line, column and the first cell that is none, and how many are blank.
        """
        self.load(name)
        return self._numbers[self.index(name)]

    def texts(self, name: str) -> list[str]:
        """Cells of the column ``name``, blanks around them left out; those of a typed column as Python writes them."""
        index = self.index(name)
        self._used.add(index)
        texts = self._source.texts([index])
        if texts is None:
            return ["" if value is None else str(value) for value in self._source.typed(index).to_pylist()]
        return [cell.strip() for cell in texts[0][: len(self)]]

    def load(self, *names: str) -> None:
        """Read several columns in one pass, as :meth:`numbers` does."""
        indices = [index for index in map(self.index, names) if index not in self._numbers]
        self._used.update(indices)
        texts = self._source.texts(indices)
        for position, index in enumerate(indices):
            name = self.names[index]
            if texts is None:
                self._numbers[index] = self._typed_numbers(name, self._source.typed(index))
            else:
                self._numbers[index] = self._text_numbers(name, texts[position][: len(self)])

    def _text_numbers(self, name: str, cells: list[str]) -> NDArray[np.float64]:
        if _PLAIN.fullmatch("\n".join(cells)) and self.dialect.decimal == ".":
            try:
                values = np.array(list(map(float, cells)), dtype=np.float64)
            except ValueError:
                values = None
            if values is not None and np.isfinite(values).all():
                return values
        values = np.empty(len(cells))
        for row, cell in enumerate(cells):
            value = parse_number(cell, self.dialect.decimal)
            if value is None:
                raise ValueError(self._not_a_number(name, row, cell, sum(not c.strip() for c in cells)))
            values[row] = value
        return values

    def _not_a_number(self, name: str, row: int, cell: str, blank: int) -> str:
        said = f"{self.where(row)}: {listed([name])} = {shown(cell)} is not a finite number"
        if not cell.strip():
            return f"{said}: it is blank in {blank:,} of {len(self):,} rows; leave such rows, or the column, out"
        if parse_number(cell, "," if self.dialect.decimal == "." else ".") is not None:
            mark = "point" if self.dialect.decimal == "." else "comma"
            return f"{said}: other numbers of the file have a decimal {mark}; write all with the same one"
        if THOUSANDS.search(cell):
            return f"{said}: it has separators of thousands; write the column without them"
        return f"{said}; leave such rows out"

    def _typed_numbers(self, name: str, column: Any) -> NDArray[np.float64]:
        import pyarrow.types as kinds

        kind = column.type
        if not (kinds.is_integer(kind) or kinds.is_floating(kind) or kinds.is_decimal(kind)):
            raise ValueError(f"{self.path}: column {shown(name)} does not hold numbers, but {_kind_in_words(kind)}")
        if column.null_count:
            row = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
            raise ValueError(self._not_a_number(name, row, "", column.null_count))
        if kinds.is_decimal(kind):
            values = np.array([float(value) for value in column.to_pylist()], dtype=np.float64)
        else:
            values = column.to_numpy(zero_copy_only=False).astype(np.float64)
        for row in np.flatnonzero(~np.isfinite(values)):
            raise ValueError(self._not_a_number(name, int(row), str(values[row]), 0))
        return values

    def elapsed(self, name: str, unit: Unit | None) -> tuple[NDArray[np.float64], str]:
        """Seconds since the first row's instant, and how the column was read.

        Whole numbers are subtracted before they become floats; ISO 8601 stamps, times of day and Parquet's timestamps
        and durations need no unit.

        Args:
            name: Column of the clock.
            unit: That its name says; None: seconds, unless the values can only be another unit's count since 1970.

        Raises:
            ValueError: a cell is no time, or the values cannot be in this unit.
        """
        index = self.index(name)
        self._used.add(index)
        texts = self._source.texts([index])
        if texts is None:
            return self._typed_elapsed(name, unit, self._source.typed(index))
        cells = texts[0][: len(self)]
        if cells and _stamp(cells[0]) is not None:
            return _since_first(np.array(self._stamps(name, cells), dtype=object), 1e-9), "stamps of date and time"
        if all(_INTEGER.fullmatch(cell.strip()) for cell in cells):
            return self._counted(name, unit, np.array([int(cell) for cell in cells], dtype=object))
        values = self.numbers(name)
        factor, said = self._clock_unit(name, unit, float(np.max(np.abs(values))))
        return (values - values[0]) * factor if factor != 1.0 else values - values[0], said

    def starts_at(self, name: str, unit: Unit | None) -> float:
        """Seconds of a clock's first row; 0 where it holds stamps, or counts for longer than a year."""
        try:
            first = float(self.numbers(name)[0]) * (1.0 if unit is None else unit.factor)
        except ValueError:
            return 0.0
        return first if abs(first) < 3e7 else 0.0

    def _counted(self, name: str, unit: Unit | None, ticks: NDArray[Any]) -> tuple[NDArray[np.float64], str]:
        factor, said = self._clock_unit(name, unit, float(max(map(abs, ticks))))
        return _since_first(ticks, factor), said

    def _stamps(self, name: str, cells: list[str]) -> list[int]:
        stamps = []
        for row, cell in enumerate(cells):
            stamp = _stamp(cell)
            if stamp is None:
                raise ValueError(
                    f"{self.where(row)}: {listed([name])} = {shown(cell)} is no time as the rows before it"
                )
            stamps.append(stamp)
        dates = {re.split(r"[T ,]", cell.strip())[0] for cell in cells} if "/" in cells[0] else set()
        if len(dates) > 1:
            raise ValueError(
                f"{self.path}: day and month of {listed([name])} cannot be told apart, from {shown(min(dates))} to "
                f"{shown(max(dates))}; write 2026-05-04T08:00:00"
            )
        return stamps

    def _typed_elapsed(self, name: str, unit: Unit | None, column: Any) -> tuple[NDArray[np.float64], str]:
        import pyarrow
        import pyarrow.types as kinds

        kind = column.type
        if column.null_count:
            row = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
            raise ValueError(self._not_a_number(name, row, "", column.null_count))
        if kinds.is_timestamp(kind) or kinds.is_duration(kind) or kinds.is_time(kind):
            width = pyarrow.int32() if kinds.is_time32(kind) else pyarrow.int64()
            ticks = column.view(width).to_numpy(zero_copy_only=False).astype(object)
            factor = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
            what = {True: "timestamps", False: "durations"}[kinds.is_timestamp(kind)]
            return _since_first(ticks, factor), f"Parquet {what} in {kind.unit}"
        if kinds.is_string(kind) or kinds.is_large_string(kind):
            stamps = self._stamps(name, column.to_pylist())
            return _since_first(np.array(stamps, dtype=object), 1e-9), "stamps of date and time"
        if kinds.is_integer(kind):
            return self._counted(name, unit, np.array(column.to_pylist(), dtype=object))
        values = self._typed_numbers(name, column)
        factor, said = self._clock_unit(name, unit, float(np.max(np.abs(values))))
        return (values - values[0]) * factor if factor != 1.0 else values - values[0], said

    def _clock_unit(self, name: str, unit: Unit | None, largest: float) -> tuple[float, str]:
        """SI value of a clock's unit, and that unit in words."""
        factor = 1.0 if unit is None else unit.factor
        if largest * factor <= LARGEST_TIME:
            return factor, "s, as no unit is named" if unit is None else unit.symbol
        words = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
        fitting = [key for key, size in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if 3e8 < largest * size < 5e9]
        if unit is None and fitting:
            return {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}[fitting[0]], f"{words[fitting[0]]} since 1970, by its values"
        hint = f"these are {words[fitting[0]]} since 1970: name it time_{fitting[0]}" if fitting else "name its unit"
        as_ = "s" if unit is None else unit.symbol
        raise ValueError(f"{self.path}: {listed([name])} reaches {largest:.6g}, which is no time in {as_}; {hint}")


def _since_first(ticks: NDArray[Any], factor: float) -> NDArray[np.float64]:
    """Seconds since the first of whole numbers of ticks."""
    if not len(ticks):
        return np.zeros(0)
    steps = (ticks - ticks[0]).astype(np.float64)
    # a division by a whole number rounds once: 10 ms are 0.01 s
    return steps / round(1.0 / factor) if factor < 1.0 else steps * factor


_STAMP = re.compile(
    r"(?:(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)[T ]|(?P<day2>\d\d?)\.(?P<month2>\d\d?)\.(?P<year2>\d{4})[T ,]\s*|"
    r"\d\d?/\d\d?/\d{4}[T ,]\s*)?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,](?P<part>\d{1,15}))?)?"
    r"\s*(?:Z|UTC|GMT|(?P<zone>[+-]\d\d(?::?\d\d)?))?",
    re.ASCII,
)


def _stamp(cell: str) -> int | None:
    """Nanoseconds of a date and time (ISO 8601, or day.month.year), or of a time of day; None if it is neither.

    Day and month cannot be told apart between slashes: such a date counts for nothing.
    """
    match = _STAMP.fullmatch(cell.strip()) if len(cell) < 80 else None
    if match is None:
        return None
    year, month, day = (match[key] or match[f"{key}2"] for key in ("year", "month", "day"))
    try:
        days = date(int(year), int(month), int(day)).toordinal() if year else 0
    except ValueError:
        return None
    hour, minute, second = int(match["hour"]), int(match["minute"]), int(match["second"] or 0)
    if hour > 24 or minute > 59 or second > 60:
        return None
    zone = match["zone"] or "+0000"
    offset = int(zone[1:3]) * 60 + int(zone[3:].lstrip(":") or 0)
    minutes = (days * 24 + hour) * 60 + minute - (offset if zone[0] == "+" else -offset)
    return (minutes * 60 + second) * 10**9 + int((match["part"] or "0").ljust(9, "0")[:9])


def _kind_in_words(kind: Any) -> str:
    import pyarrow.types as kinds

    for is_kind, words in (
        (kinds.is_boolean, "true and false"), (kinds.is_timestamp, "timestamps"), (kinds.is_duration, "durations"),
        (kinds.is_temporal, "dates or times"), (kinds.is_string, "text"), (kinds.is_large_string, "text"),
    ):  # fmt: skip
        if is_kind(kind):
            return words
    return f"values of type {str(kind)[:LONGEST_ECHO]}"


# --------------------------------------------------------------------------------------------------------------- files


def read_table(path: Path) -> Table:
    """Read a table with a header: CSV, text in columns, or Parquet.

    Raises:
        ValueError: the file cannot be a table; names it, the line and the reason.
    """
    if not path.is_file():
        raise ValueError(f"{path} is not a file" if path.exists() else f"file {path} does not exist")
    with path.open("rb") as stream:
        is_parquet = stream.read(4) == b"PAR1"
    if is_parquet or path.suffix.lower() in (".parquet", ".pq"):
        return _read_parquet(path)
    return _read_text(path)


@dataclass(frozen=True)
class _Text:
    """Cells of a text file, which is gone through once for all columns that are asked for together."""

    text: str
    dialect: Dialect

    def rows(self) -> Iterator[_Record]:
        lines = io.StringIO(self.text)
        for _ in range(self.dialect.skip):
            next(lines)
        yield from _records(lines, self.dialect.separator, before=self.dialect.skip)

    def texts(self, indices: Sequence[int]) -> list[list[str]]:
        if not indices:
            return []
        if len(indices) == 1:
            return [[record.cells[indices[0]] for record in self.rows()]]
        pick = itemgetter(*indices)
        return [list(cells) for cells in zip(*(pick(record.cells) for record in self.rows()), strict=True)]

    def typed(self, index: int) -> Any:
        raise NotImplementedError


def _read_text(path: Path) -> Table:
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise ValueError(f"{path} has {size:,} bytes, more than {LARGEST_FILE:,}; split it, or write Parquet")
    data = path.read_bytes()
    try:
        encoding = find_encoding(data)
        text = io.IncrementalNewlineDecoder(None, translate=True).decode(_decoded(data, encoding, True), final=True)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a CSV text file: byte {error.start + 1:,} is no {error.encoding}") from None
    except ValueError as error:
        raise ValueError(f"{path} is not a CSV text file: {str(error).removeprefix('is not a text file: ')}") from None
    dialect = _find_dialect(text, encoding)
    if dialect.separator != "," and not re.search(r"[0-9]\.[0-9]", text) and re.search(r"[0-9],[0-9]", text):
        dialect = replace(dialect, decimal=",")  # whole numbers for long, as at rest
    names = dialect.names
    if not names:
        hint = "" if not text.strip() else f"; its first line is {shown(text.strip().splitlines()[0])}"
        raise ValueError(f"{path} holds no rows under a header such as time_s,steering_signal{hint}")
    if len(names) > MOST_COLUMNS:
        raise ValueError(f"{path} has {len(names):,} columns, more than {MOST_COLUMNS:,}; leave out what is not needed")
    source = _Text(text, dialect)
    lines = _checked_rows(path, source, len(names))
    if not lines:
        raise ValueError(f"{path} holds no rows; it needs a header such as time_s,steering_signal and rows of numbers")
    if dialect.count not in (None, len(lines)):
        raise ValueError(f"{path}, before its rows: {dialect.count:,} rows are declared, but {len(lines):,} follow")
    return Table(path, names, np.array(lines), dialect, not text.endswith("\n"), source)


def _checked_rows(path: Path, source: _Text, width: int) -> list[int]:
    """Lines that rows begin on."""
    lines: list[int] = []
    most = MOST_CELLS // width
    try:
        for record in source.rows():
            if len(record.cells) != width and _width(record, width) != width:
                raise ValueError(
                    f"line {record.first}: {len(record.cells)} values where the header names {width} columns"
                )
            lines.append(record.last)
            if len(lines) > most:
                raise ValueError(f"more than {MOST_CELLS:,} cells; split it, or leave out columns")
    except ValueError as error:
        mark = "," if str(error).startswith("line") else ":"
        raise ValueError(f"{path}{mark} {error}") from None
    return lines


@dataclass(frozen=True)
class _Parquet:
    """Columns of a Parquet file."""

    path: Path
    rows: int
    """As its metadata say."""

    def texts(self, indices: Sequence[int]) -> None:
        return None

    def typed(self, index: int) -> Any:
        import pyarrow
        import pyarrow.parquet

        try:
            with pyarrow.parquet.ParquetFile(self.path) as file:
                name = file.schema_arrow.names[index]
                column = file.read(columns=[name]).column(name).combine_chunks()
            if isinstance(column, pyarrow.ChunkedArray):
                column = column.chunk(0) if column.num_chunks else pyarrow.array([], column.type)
            if pyarrow.types.is_dictionary(column.type):
                column = column.dictionary_decode()
        except (pyarrow.ArrowException, OSError, KeyError, UnicodeDecodeError) as error:
            raise ValueError(f"{self.path} is not a whole Parquet file: {_one_line(error)}") from None
        if len(column) != self.rows:
            raise ValueError(
                f"{self.path} is not a whole Parquet file: column {shown(name)} has {len(column):,} of {self.rows:,} rows"
            )
        return column


def _read_parquet(path: Path) -> Table:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise ValueError(f"{path} needs pyarrow: pip install 'aoro-gym[parquet]'") from None
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            names = tuple(file.schema_arrow.names)
            rows = file.metadata.num_rows
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a Parquet file: {_one_line(error)}") from None
    if rows <= 0 or not names:
        raise ValueError(f"{path} holds no rows")
    if rows * len(names) > MOST_CELLS or len(names) > MOST_COLUMNS:
        raise ValueError(
            f"{path} has {rows:,} rows of {len(names):,} columns; more than {MOST_CELLS:,} cells or {MOST_COLUMNS:,} "
            "columns are not read"
        )
    return Table(
        path, names, np.arange(1, rows + 1), Dialect(names=names, columns=len(names)), False, _Parquet(path, rows)
    )


def _one_line(error: Exception) -> str:
    """The first line of what a library says."""
    lines = str(error).splitlines()
    return lines[0][: LONGEST_ECHO * 3] if lines else type(error).__name__
