"""Versioned records in datagrams, for controllers and laboratories beside the twin: framing, strict decoding, field tables.

A frame is one UDP datagram: a header of 40 bytes, the payload, with a token an authentication tag of 16 bytes, and a CRC-32
(IEEE 802.3, as in zlib) of all that stands before it. Everything is little-endian and packed without gaps:

    "AORO" · version u8 · kind u8 · length of the payload u16 · session u64 · sender u64 · sequence u64 · time f64 · payload
    · [tag] · CRC-32 u32

``session`` is drawn anew by every server and given back by those who talk to it, so that what was recorded in an earlier run
is foreign in a later one. ``sender`` is drawn anew by every process that sends, and ``sequence`` rises with each of its
frames: what arrives again, or late, is a replay. The tag is HMAC-SHA-256 (RFC 2104) under the token over header and
payload, cut to 128 bits. The same frame as a JSON object on one line is the second encoding, for people; its ``tag`` is that
of the binary frame, in hexadecimal digits.

Decoding never raises: what is wrong with a datagram is a :class:`Rejection` with a :class:`Reason`.

Kinds below 32 are the server's, those from 32 on the laboratory's, those from 128 on free for others.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import math
import secrets
import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

from aoro_gym.checks import check_choice, check_integer, check_range

MAGIC = b"AORO"
VERSION = 1
LARGEST_DATAGRAM = 1400
"""Bytes: below the 1500 of an Ethernet frame, so that no datagram is ever cut into several."""
LARGEST_IDENTIFIER = 2**53 - 1
"""Of session, sender and sequence: what a JSON reader that knows only doubles still tells apart."""
LATEST = 1e9
"""Latest time [s] of a frame: 32 years."""
MOST_SENDERS = 65_536
"""Senders whose last sequence number a receiver remembers (6 MB); more are refused, never forgotten: that would let in
replays. A controller that is restarted every second fills it in 18 hours."""

_HEADER = struct.Struct("<4sBBHQQQd")
_CHECKSUM = struct.Struct("<I")
_TAG = 16
HEADER_SIZE, CHECKSUM_SIZE, TAG_SIZE = _HEADER.size, _CHECKSUM.size, _TAG

TYPES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i32": "i", "f32": "f", "f64": "d"}
"""Types of fields, and how :mod:`struct` calls them."""


class Reason(StrEnum):
    """What is wrong with a datagram that is dropped."""

    OVERSIZED = "oversized"
    MALFORMED = "malformed"
    FOREIGN = "foreign"
    VERSION = "version"
    CHECKSUM = "checksum"
    UNAUTHENTICATED = "unauthenticated"
    KIND = "kind"
    SESSION = "session"
    NON_FINITE = "non-finite"
    OUT_OF_RANGE = "out of range"
    REPLAYED = "replayed"
    SENDERS = "too many senders"
    STALE = "stale"
    BUSY = "busy"


REASONS = {
    Reason.OVERSIZED: f"longer than {LARGEST_DATAGRAM} bytes",
    Reason.MALFORMED: "a length, a field or a type that the record does not have, or broken JSON",
    Reason.FOREIGN: "does not begin with AORO, and is no JSON object with the member aoro",
    Reason.VERSION: "another version of this protocol",
    Reason.CHECKSUM: "CRC-32 does not agree",
    Reason.UNAUTHENTICATED: "no tag, or one that was made with another token",
    Reason.KIND: "a kind of record that is not received here",
    Reason.SESSION: "the session of another run, or none",
    Reason.NON_FINITE: "a value is NaN or infinite",
    Reason.OUT_OF_RANGE: "a value is outside of its field's bounds",
    Reason.REPLAYED: "its sequence number does not exceed the sender's last one",
    Reason.SENDERS: f"more than {MOST_SENDERS} senders in one run",
    Reason.STALE: "answers what was measured too long ago",
    Reason.BUSY: "another sender is in command",
}
"""Each reason in words."""


@dataclass(frozen=True)
class Field:
    """One number of a record."""

    name: str
    type: str
    """One of ``TYPES``."""
    unit: str
    low: float
    high: float
    text: str
    """What it is."""
    default: float | None = None
    """Value in JSON where the member is left out; None: it must be there."""

    def __post_init__(self) -> None:
        check_choice(f"type of field {self.name}", self.type, TYPES)
        check_range(f"low of field {self.name}", self.low, self.unit, le=self.high, note=", which is high")

    @property
    def whole(self) -> bool:
        """Whether its values are whole numbers."""
        return self.type[0] != "f"


@dataclass(frozen=True)
class Record:
    """A kind of frame: its number, and the fields of its payload in their order."""

    name: str
    kind: int
    fields: tuple[Field, ...]
    text: str = ""
    """What it is for."""

    def __post_init__(self) -> None:
        check_integer(f"kind of record {self.name}", self.kind, ge=1, le=255)
        names = [one.name for one in self.fields]
        if len(set(names)) != len(names) or set(names) & _MEMBERS:
            raise ValueError(f"record {self.name}: field names must differ from each other and from {sorted(_MEMBERS)}")
        size = HEADER_SIZE + self.payload.size + TAG_SIZE + CHECKSUM_SIZE
        check_integer(f"size of record {self.name}", size, le=LARGEST_DATAGRAM, note=" bytes; leave out fields")

    @cached_property
    def payload(self) -> struct.Struct:
        """Layout of the payload."""
        return struct.Struct("<" + "".join(TYPES[one.type] for one in self.fields))

    @cached_property
    def offsets(self) -> dict[str, int]:
        """Byte of the datagram at which each field begins."""
        place, found = HEADER_SIZE, {}
        for one in self.fields:
            found[one.name] = place
            place += struct.calcsize("<" + TYPES[one.type])
        return found


@dataclass(frozen=True)
class Frame:
    """A record with what it carries."""

    record: Record
    session: int
    sender: int
    sequence: int
    time: float
    """[s] by the sender's clock."""
    values: Mapping[str, float]
    """By the names of the record's fields; of the types that fields have, so float32 where they say so."""


@dataclass(frozen=True)
class Rejection:
    """A datagram that was dropped."""

    reason: Reason
    detail: str
    """One line, for a log."""


_MEMBERS = {"aoro", "kind", "session", "sender", "sequence", "time", "tag"}


def encode(frame: Frame, token: bytes | None = None) -> bytes:
    """The datagram of a frame; ValueError that names a value which its record cannot carry."""
    body = _body(frame)
    tag = b"" if token is None else _tag(body, token)
    return body + tag + _CHECKSUM.pack(zlib.crc32(body + tag))


def encode_json(frame: Frame, token: bytes | None = None) -> bytes:
    """The same as one line of JSON, its line feed included."""
    body = _body(frame)
    members: dict[str, Any] = {"aoro": VERSION, "kind": frame.record.name, "session": frame.session}
    members |= {"sender": frame.sender, "sequence": frame.sequence, "time": frame.time}
    values = frame.record.payload.unpack_from(body, HEADER_SIZE)
    members |= {one.name: value for one, value in zip(frame.record.fields, values, strict=True)}
    if token is not None:
        members["tag"] = _tag(body, token).hex()
    return json.dumps(members, allow_nan=False, separators=(", ", ": ")).encode() + b"\n"


def decode(datagram: bytes, records: Mapping[int, Record], token: bytes | None = None) -> Frame | Rejection:
    """The frame that a datagram holds in either encoding, or what is wrong with it.

    Nothing is remembered: :class:`Receiver` also knows sessions and replays.

    Args:
        datagram: As it was received.
        records: By their kinds: what may arrive.
        token: Which frames must be authenticated with; None: they carry no tag.
    """
    if len(datagram) > LARGEST_DATAGRAM:
        return Rejection(Reason.OVERSIZED, f"{len(datagram)} bytes or more")
    found = _from_json(datagram, records, token) if datagram[:1] == b"{" else _from_binary(datagram, records, token)
    return found if isinstance(found, Rejection) else _checked(found)


def draw_identifier() -> int:
    """A random session or sender, from 1 to ``LARGEST_IDENTIFIER``."""
    return 1 + secrets.randbelow(LARGEST_IDENTIFIER)


@dataclass
class Sender:
    """Numbers the frames of one process.

    >>> import math
    >>> record = Record("torque", 128, (Field("hub", "f32", "N m", -1e5, 1e5, "of the front left hub"),))
    >>> datagram = Sender().encode(record, 7, 0.001, {"hub": 250.0})
    >>> Receiver([record], session=7).decode(datagram).values
    {'hub': 250.0}
    """

    token: bytes | None = None
    identifier: int = field(default_factory=draw_identifier)
    sequence: int = 0
    """Of the last frame."""

    def frame(self, record: Record, session: int, time: float, values: Mapping[str, float]) -> Frame:
        """The next frame, in ``session``, at ``time`` [s]."""
        self.sequence += 1
        return Frame(record, session, self.identifier, self.sequence, time, values)

    def encode(self, record: Record, session: int, time: float, values: Mapping[str, float]) -> bytes:
        """The next frame's datagram; raises as :func:`encode`."""
        return encode(self.frame(record, session, time, values), self.token)


class Receiver:
    """Decodes what arrives in one session, and counts what is dropped.

    Args:
        records: What may arrive.
        session: Which frames must name; None: any.
        token: Which frames must be authenticated with; None: they carry no tag.
        greetings: Records that may name session 0, too: those that ask which session it is. They are not kept from being
            replayed.
    """

    def __init__(
        self,
        records: Iterable[Record],
        *,
        session: int | None = None,
        token: bytes | None = None,
        greetings: Iterable[Record] = (),
    ):
        self._records = {record.kind: record for record in records}
        self._greetings = {record.kind for record in greetings}
        self.session = session
        self.token = token
        self.accepted = 0
        """Frames so far."""
        self.rejected: Counter[Reason] = Counter()
        """Datagrams that were dropped so far, by reason."""
        self._last: dict[int, int] = {}  # sequence number by sender

    def decode(self, datagram: bytes) -> Frame | Rejection:
        """The frame in a datagram, or why it is dropped."""
        found = decode(datagram, self._records, self.token)
        if isinstance(found, Frame):
            found = self._in_order(found)
        if isinstance(found, Rejection):
            self.rejected[found.reason] += 1
        else:
            self.accepted += 1
        return found

    def withdraw(self, reason: Reason, detail: str) -> Rejection:
        """Count the frame that was accepted last as dropped, for a reason which only its receiver knows."""
        self.accepted -= 1
        self.rejected[reason] += 1
        return Rejection(reason, detail)

    def _in_order(self, frame: Frame) -> Frame | Rejection:
        if frame.session == 0 and frame.record.kind in self._greetings:
            return frame
        if self.session is not None and frame.session != self.session:
            return Rejection(Reason.SESSION, f"session {frame.session}, but this is {self.session}")
        last = self._last.get(frame.sender)
        if last is None and len(self._last) >= MOST_SENDERS:
            return Rejection(Reason.SENDERS, f"sender {frame.sender} is one too many")
        if last is not None and frame.sequence <= last:
            return Rejection(Reason.REPLAYED, f"sequence {frame.sequence} of sender {frame.sender} after {last}")
        self._last[frame.sender] = frame.sequence
        return frame


def field_table(record: Record) -> str:
    """The fields of a record as a table in Markdown: byte of the datagram, name, type, unit, bounds, meaning."""
    rows = [
        f"| {record.offsets[one.name]} | `{one.name}` | {one.type} | {one.unit} | {one.low:g} | {one.high:g} | {one.text} |"
        for one in record.fields
    ]
    return "\n".join(
        ["| byte | field | type | unit | least | most | what it is |", "|---|---|---|---|---|---|---|", *rows]
    )


def _body(frame: Frame) -> bytes:
    """Header and payload."""
    record, values = frame.record, frame.values
    if values.keys() != record.offsets.keys():
        wrong = sorted(values.keys() ^ record.offsets.keys())
        raise ValueError(f"record {record.name} has other fields than were given: {', '.join(wrong)}")
    for name in ("session", "sender", "sequence"):
        check_integer(name, getattr(frame, name), ge=0, le=LARGEST_IDENTIFIER)
    if not 0.0 <= frame.time <= LATEST:
        check_range("time", frame.time, "s", ge=0.0, le=LATEST)
    for one in record.fields:
        if not one.low <= values[one.name] <= one.high:
            check_range(one.name, values[one.name], one.unit, ge=one.low, le=one.high)
    ordered = [int(values[one.name]) if one.whole else values[one.name] for one in record.fields]
    head = (MAGIC, VERSION, record.kind, record.payload.size, frame.session, frame.sender, frame.sequence, frame.time)
    return _HEADER.pack(*head) + record.payload.pack(*ordered)


def _tag(body: bytes, token: bytes) -> bytes:
    return hmac.digest(token, body, hashlib.sha256)[:_TAG]


def _from_binary(datagram: bytes, records: Mapping[int, Record], token: bytes | None) -> Frame | Rejection:
    if datagram[: len(MAGIC)] != MAGIC:
        return Rejection(Reason.FOREIGN, f"begins with {datagram[:8]!r}")
    if len(datagram) < HEADER_SIZE + CHECKSUM_SIZE:
        return Rejection(Reason.MALFORMED, f"{len(datagram)} bytes are shorter than a header")
    _, version, kind, length, session, sender, sequence, time = _HEADER.unpack_from(datagram)
    if version != VERSION:
        return Rejection(Reason.VERSION, f"version {version}, but this is {VERSION}")
    end = HEADER_SIZE + length
    if len(datagram) not in (end + CHECKSUM_SIZE, end + TAG_SIZE + CHECKSUM_SIZE):
        return Rejection(Reason.MALFORMED, f"{len(datagram)} bytes with a payload of {length}")
    if zlib.crc32(datagram[:-CHECKSUM_SIZE]) != _CHECKSUM.unpack_from(datagram, len(datagram) - CHECKSUM_SIZE)[0]:
        return Rejection(Reason.CHECKSUM, "CRC-32 does not agree")
    tag = datagram[end:-CHECKSUM_SIZE]
    if token is None and tag:
        return Rejection(Reason.UNAUTHENTICATED, "carries a tag, but no token is known here")
    if token is not None and not hmac.compare_digest(tag, _tag(datagram[:end], token)):
        return Rejection(Reason.UNAUTHENTICATED, "wrong tag" if tag else "no tag")
    record = records.get(kind)
    if record is None:
        return Rejection(Reason.KIND, f"kind {kind}")
    if length != record.payload.size:
        return Rejection(Reason.MALFORMED, f"payload of {length} bytes, but {record.name} has {record.payload.size}")
    values = record.payload.unpack_from(datagram, HEADER_SIZE)
    named = {one.name: value for one, value in zip(record.fields, values, strict=True)}
    return Frame(record, session, sender, sequence, time, named)


class _Broken(ValueError):
    """JSON that is no frame."""


def _from_json(datagram: bytes, records: Mapping[int, Record], token: bytes | None) -> Frame | Rejection:
    try:
        members = json.loads(datagram.decode(), object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        return Rejection(Reason.MALFORMED, f"JSON: {str(error)[:80]}")
    if not isinstance(members, dict) or "aoro" not in members:
        return Rejection(Reason.FOREIGN, "JSON without the member aoro")
    if members["aoro"] != VERSION or isinstance(members["aoro"], bool):
        return Rejection(Reason.VERSION, f"version {str(members['aoro'])[:20]}, but this is {VERSION}")
    record = next((one for one in records.values() if one.name == members.get("kind")), None)
    if record is None:
        return Rejection(Reason.KIND, f"kind {str(members.get('kind'))[:20]!r}")
    try:
        frame = _frame_of(members, record)
    except _Broken as error:
        return Rejection(Reason.MALFORMED, str(error))
    wrong = _checked(frame)
    if isinstance(wrong, Rejection):  # a value that binary frames cannot carry has no tag
        return wrong
    tag = members.get("tag")
    if token is None and tag is not None:
        return Rejection(Reason.UNAUTHENTICATED, "carries a tag, but no token is known here")
    if token is not None and not (
        isinstance(tag, str) and hmac.compare_digest(tag.encode(), _tag(_body(frame), token).hex().encode())
    ):
        return Rejection(Reason.UNAUTHENTICATED, "no tag" if tag is None else "wrong tag")
    return frame


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        raise _Broken("a member stands there twice")
    return members


def _frame_of(members: Mapping[str, Any], record: Record) -> Frame:
    unknown = members.keys() - _MEMBERS - record.offsets.keys()
    if unknown:
        raise _Broken(f"{record.name} has no member {sorted(unknown)[0][:20]!r}")
    session, sender, sequence = (int(_number(members, name, whole=True)) for name in ("session", "sender", "sequence"))
    values = {one.name: _number(members, one.name, whole=one.whole, default=one.default) for one in record.fields}
    packed = {one.name: _packed(one, values[one.name]) for one in record.fields}
    return Frame(record, session, sender, sequence, float(_number(members, "time")), packed)


def _packed(one: Field, value: float) -> float:
    """A number of JSON as its field's type carries it."""
    if one.type != "f32" or not math.isfinite(value):
        return value
    try:
        return struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)


def _number(members: Mapping[str, Any], name: str, *, whole: bool = False, default: float | None = None) -> float:
    value = members.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _Broken(f"{name} is {'missing' if value is None else 'no number'}")
    if not whole:
        try:
            return float(value)
        except OverflowError:
            return math.inf
    if isinstance(value, float) and (not math.isfinite(value) or value != int(value)):
        raise _Broken(f"{name} is no whole number")
    return int(value)


def _checked(frame: Frame) -> Frame | Rejection:
    """The frame, if all of its numbers are finite and within their bounds."""
    bounds = [(name, getattr(frame, name), 0, LARGEST_IDENTIFIER) for name in ("session", "sender", "sequence")]
    bounds += [("time", frame.time, 0.0, LATEST)]
    bounds += [(one.name, frame.values[one.name], one.low, one.high) for one in frame.record.fields]
    for name, value, low, high in bounds:
        if not low <= value <= high:
            finite = isinstance(value, int) or math.isfinite(value)
            shown = f"{value:g}" if abs(value) < LARGEST_IDENTIFIER else "beyond all bounds"
            reason = Reason.OUT_OF_RANGE if finite else Reason.NON_FINITE
            return Rejection(reason, f"{name} is {shown}, but must be in [{low:g}, {high:g}]")
    return frame
