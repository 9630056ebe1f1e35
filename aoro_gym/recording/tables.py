"""Tables as loggers, spreadsheets and scanners write them: CSV of any dialect, text in columns, Parquet, bags of ROS.

>>> table = read_table(path)  # doctest: +SKIP
>>> table.numbers("pressure_a_bar")  # doctest: +SKIP

Only columns that are asked for are turned into numbers; :attr:`Table.unread` names the others.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import printable
from aoro_gym.recording.bag_mapping import columns_of
from aoro_gym.recording.bags import is_bag
from aoro_gym.recording.cells import LONGEST_ECHO, MISSING, THOUSANDS, listed, parse_number, shown, time_stamp
from aoro_gym.recording.dialects import (
    _INTEGER,
    Dialect,
    Record,
    _width,
    decoded,
    find_dialect,
    find_encoding,
    records_of,
)
from aoro_gym.recording.units import Unit

LARGEST_FILE = 1 << 28
"""Bytes of a text file that is read as a table."""
MOST_COLUMNS = 100_000
"""Columns of a table."""
MOST_CELLS = 50_000_000
"""Cells of a table."""
LARGEST_TIME = 1e11
"""Seconds (3,200 years) beyond which a clock is not in the unit that its name says."""
_PLAIN = re.compile(r"[0-9eE+\-.\s]*")


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
            return self._typed_numbers(name, self._source.typed(index), may_lack=True)
        values = np.full(len(self), np.nan)
        for row, cell in enumerate(texts[0]):
            if cell.strip().lower() in MISSING:
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

    def _typed_numbers(self, name: str, column: Any, *, may_lack: bool = False) -> NDArray[np.float64]:
        import pyarrow.types as kinds

        kind = column.type
        if not (kinds.is_integer(kind) or kinds.is_floating(kind) or kinds.is_decimal(kind)):
            raise ValueError(f"{self.path}: column {shown(name)} does not hold numbers, but {_kind_in_words(kind)}")
        if column.null_count and not may_lack:
            row = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
            raise ValueError(self._not_a_number(name, row, "", column.null_count))
        if kinds.is_decimal(kind):
            values = np.array(
                [np.nan if value is None else float(value) for value in column.to_pylist()], dtype=np.float64
            )
        else:
            values = column.to_numpy(zero_copy_only=False).astype(np.float64)
        for row in np.flatnonzero(np.isinf(values) if may_lack else ~np.isfinite(values)):
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
        if cells and time_stamp(cells[0]) is not None:
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
            stamp = time_stamp(cell)
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


def _kind_in_words(kind: Any) -> str:
    import pyarrow.types as kinds

    for is_kind, words in (
        (kinds.is_boolean, "true and false"), (kinds.is_timestamp, "timestamps"), (kinds.is_duration, "durations"),
        (kinds.is_temporal, "dates or times"), (kinds.is_string, "text"), (kinds.is_large_string, "text"),
    ):  # fmt: skip
        if is_kind(kind):
            return words
    return f"values of type {str(kind)[:LONGEST_ECHO]}"


def read_table(path: Path) -> Table:
    """Read a table with a header: CSV, text in columns, Parquet, or a bag (:mod:`.bag_mapping`).

    Raises:
        ValueError: the file cannot be a table; names it, the line and the reason.
    """
    if is_bag(path):
        return _read_bag(path)
    if not path.is_file():
        folder = f"{path} is not a file; name the files in it, such as {path}/*.csv"
        raise ValueError(folder if path.exists() else f"file {path} does not exist")
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

    def rows(self) -> Iterator[Record]:
        lines = io.StringIO(self.text)
        for _ in range(self.dialect.skip):
            next(lines)
        yield from records_of(lines, self.dialect.separator, before=self.dialect.skip)

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
        text = io.IncrementalNewlineDecoder(None, translate=True).decode(decoded(data, encoding, True), final=True)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a CSV text file: byte {error.start + 1:,} is no {error.encoding}") from None
    except ValueError as error:
        raise ValueError(f"{path} is not a CSV text file: {str(error).removeprefix('is not a text file: ')}") from None
    dialect = find_dialect(text, encoding)
    if dialect.separator != "," and not re.search(r"[0-9]\.[0-9]", text) and re.search(r"[0-9],[0-9]", text):
        dialect = replace(dialect, decimal=",")  # whole numbers for long, as at rest
    names = tuple(map(printable, dialect.names))
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
            names = tuple(map(printable, file.schema_arrow.names))
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


@dataclass(frozen=True)
class _Columns:
    """Columns of a bag."""

    values: Sequence[NDArray[np.float64]]

    def texts(self, indices: Sequence[int]) -> None:
        return None

    def typed(self, index: int) -> Any:
        import pyarrow

        return pyarrow.array(self.values[index])


def _read_bag(path: Path) -> Table:
    columns = columns_of(path)
    names, rows = tuple(columns), len(columns["time_s"])
    source = _Columns(tuple(columns.values()))
    return Table(path, names, np.arange(1, rows + 1), Dialect(names=names, columns=len(names)), False, source)


def _one_line(error: Exception) -> str:
    """The first line of what a library says."""
    lines = str(error).splitlines()
    return lines[0][: LONGEST_ECHO * 3] if lines else type(error).__name__
