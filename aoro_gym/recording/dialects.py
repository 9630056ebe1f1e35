"""Dialects of text tables: encoding, separator, decimal mark, header, unit line and first row."""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording.cells import MISSING, is_number, parse_number, shown, time_stamp
from aoro_gym.recording.units import DIMENSIONS, find_unit

SAMPLE = 1 << 16
"""Bytes at the begin of a file that tell its dialect."""
SAMPLE_LINES = 200
"""Lines that tell it, at most; at least a tenth of them, however long they are."""
COMMENTS = ("#", "//", "%")
"""What a comment line begins with; the last one before the rows may hold the header."""
_SEPARATORS: tuple[str | None, ...] = ("\t", ";", "|", ",", None)
_INTEGER = re.compile(r"[+-]?[0-9]{1,40}")


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
    text = io.IncrementalNewlineDecoder(None, translate=True).decode(decoded(sample, encoding, is_whole))
    return find_dialect(text if is_whole else text[: text.rfind("\n") + 1] or text, encoding)


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
        decoded(sample, "utf-8", False)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def decoded(data: bytes, encoding: str, is_whole: bool) -> str:
    text = codecs.getincrementaldecoder(encoding)().decode(data, final=is_whole)
    if control := re.search(r"[\x00-\x08\x0e-\x19\x1b-\x1f\x7f]", text):
        line = text.count("\n", 0, control.start()) + 1
        raise ValueError(f"is not a text file: line {line} holds the control character {control[0]!r}")
    return text.rstrip("\x1a")  # DOS's end of a file


@dataclass(frozen=True)
class Record:
    """A line of cells: where it begins and ends."""

    first: int
    last: int
    cells: list[str]

    @cached_property
    def numbers(self) -> int:
        """Cells that are numbers or times."""
        return sum(1 for cell in self.cells if is_number(cell) or time_stamp(cell) is not None)

    @cached_property
    def filled(self) -> int:
        return sum(1 for cell in self.cells if cell.strip())


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def records_of(
    lines: Iterable[str], separator: str | None, *, before: int = 0, is_whole: bool = True
) -> Iterator[Record]:
    """Lines with cells, after ``before`` others; comments and blank lines are passed over.

    Raises:
        ValueError: a quotation mark is not closed.
    """
    if separator is None:
        for number, line in enumerate(lines, before + 1):
            if not _is_comment(line) and (cells := line.split()):
                yield Record(number, number, cells)
        return
    bare = ("\n" if _is_comment(line) else line for line in lines)
    reader = csv.reader(bare, delimiter=separator, skipinitialspace=True, strict=True)
    last = 0
    try:
        for cells in reader:
            if any(map(str.strip, cells)):
                yield Record(before + last + 1, before + reader.line_num, cells)
            last = reader.line_num
    except csv.Error as error:
        if is_whole:
            what = "a quotation mark is not closed" if "end of data" in str(error) else str(error)
            raise ValueError(f"line {before + last + 1}: {what}") from None


def find_dialect(text: str, encoding: str) -> Dialect:
    """The dialect of ``text``, by the separator under which most cells of lines of one length are numbers."""
    lines = _first_lines(text)
    forced = re.fullmatch(r'"?sep=(.)"?', lines[0].strip()) if lines else None
    best: tuple[tuple[bool, float, int], Dialect] | None = None
    for rank, separator in enumerate([forced[1]] if forced else _SEPARATORS):
        records = list(records_of(lines, separator, is_whole=False))
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
        return _layout(lines, list(records_of(lines, ",", is_whole=False)), 1, ",", encoding)
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


def _usual(records: list[Record]) -> int:
    """Cells that most lines have, a last one that is always blank left out."""
    if not records:
        return 0
    (most, _), *_ = Counter(len(record.cells) for record in records).most_common(1)
    alike = [record.cells for record in records if len(record.cells) == most]
    usual = most
    while usual > 1 and not any(cells[usual - 1].strip() for cells in alike):
        usual -= 1
    return usual


def _width(record: Record, usual: int) -> int:
    """Cells of a line, blank ones beyond the usual ones left out."""
    return usual if len(record.cells) > usual and not any(map(str.strip, record.cells[usual:])) else len(record.cells)


def _is_unit_line(record: Record) -> bool:
    """Whether at least half of a line's cells are units, and none is another number than 1."""
    cells = [cell.strip() for cell in record.cells if cell.strip()]
    if not cells or is_number(cells[0]) or any(is_number(cell) and cell != "1" for cell in cells):
        return False
    known = sum(1 for cell in cells if find_unit(cell.strip("[](){} "), *DIMENSIONS) is not None)
    return 2 * known >= len(cells)


def _layout(lines: list[str], records: list[Record], usual: int, separator: str | None, encoding: str) -> Dialect:
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


def _header(records: list[Record], texts: list[int], usual: int) -> int | None:
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
    for record in records_of(lines, dialect.separator, before=first_line - 1):
        line = record.first
        if len(record.cells) <= max(columns):
            raise ValueError(
                f"{where}, line {line}: {len(record.cells)} values where a row has {max(columns) + 1} or more"
            )
        row = []
        for column in columns:
            cell = record.cells[column]
            value = parse_number(cell, dialect.decimal)
            if value is None and cell.strip().lower() not in MISSING:
                raise ValueError(f"{where}, line {line}: {shown(cell)} in column {column + 1} is not a number")
            row.append(np.nan if value is None else value)
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns))
