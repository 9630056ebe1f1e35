"""Frames come back as they were sent; everything else is refused with its reason, and never raises."""

import doctest
import json
import math
import struct
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aoro_gym.cosimulation import protocol
from aoro_gym.cosimulation.protocol import (
    CHECKSUM_SIZE,
    HEADER_SIZE,
    LARGEST_DATAGRAM,
    LARGEST_IDENTIFIER,
    Field,
    Frame,
    Reason,
    Receiver,
    Record,
    Rejection,
    Sender,
    decode,
    encode,
    encode_json,
    field_table,
)

RECORD = Record(
    "probe",
    200,
    (
        Field("volts", "f32", "V", 0.5, 4.5, "a voltage"),
        Field("gear", "u8", "1", 1, 3, "a gear", default=1),
        Field("torque", "f64", "N m", -1e6, 1e6, "a torque"),
    ),
)
OTHER = Record("other", 201, ())
RECORDS = {RECORD.kind: RECORD, OTHER.kind: OTHER}
VALUES = {"volts": 2.25, "gear": 2, "torque": 0.1}
TOKEN = b"a token of enough bytes"
FRAME = Frame(RECORD, 11, 12, 13, 1.5, VALUES)

frames = st.builds(
    Frame,
    st.just(RECORD),
    *(st.integers(0, LARGEST_IDENTIFIER),) * 3,
    st.floats(0.0, 1e9),
    st.fixed_dictionaries(
        {"volts": st.floats(0.5, 4.5, width=32), "gear": st.integers(1, 3), "torque": st.floats(-1e6, 1e6)}
    ),
)


def resealed(datagram: bytes) -> bytes:
    """The same bytes under a checksum that agrees."""
    body = datagram[:-CHECKSUM_SIZE]
    return body + struct.pack("<I", zlib.crc32(body))


def reason(datagram: bytes, token: bytes | None = None) -> Reason:
    found = decode(datagram, RECORDS, token)
    assert isinstance(found, Rejection), found
    assert "\n" not in found.detail and len(found.detail) < 160
    return found.reason


@settings(max_examples=60, deadline=None)
@given(frames, st.sampled_from([None, TOKEN]), st.sampled_from([encode, encode_json]))
def test_a_frame_comes_back(frame, token, encoding):
    assert decode(encoding(frame, token), RECORDS, token) == frame


def test_the_layout_is_what_the_documentation_says():
    datagram = encode(FRAME)
    assert struct.unpack("<4sBBHQQQd", datagram[:40]) == (b"AORO", 1, 200, 13, 11, 12, 13, 1.5)
    assert struct.unpack("<fBd", datagram[40:53]) == (2.25, 2, 0.1)
    assert struct.unpack("<I", datagram[53:]) == (zlib.crc32(datagram[:53]),)
    assert RECORD.offsets == {"volts": 40, "gear": 44, "torque": 45}
    assert "| 44 | `gear` | u8 | 1 | 1 | 3 | a gear |" in field_table(RECORD)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200) | st.binary(max_size=150).map(lambda rest: b"AORO\x01\xc8" + rest))
def test_noise_is_refused(datagram):
    for token in (None, TOKEN):
        assert isinstance(decode(datagram, RECORDS, token), Rejection)
        assert isinstance(decode(b"{" + datagram, RECORDS, token), Rejection)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_flipped_bit_is_noticed(data):
    datagram = bytearray(encode(FRAME, data.draw(st.sampled_from([None, TOKEN]), "token")))
    bit = data.draw(st.integers(0, 8 * len(datagram) - 1), "bit")
    datagram[bit // 8] ^= 1 << bit % 8
    for token in (None, TOKEN):
        assert isinstance(decode(bytes(datagram), RECORDS, token), Rejection)


def test_every_length_is_checked():
    whole = encode(FRAME)
    for length in range(len(whole)):
        assert reason(whole[:length]) in (Reason.FOREIGN, Reason.MALFORMED)
        if length != len(whole) - CHECKSUM_SIZE:
            assert isinstance(decode(resealed(whole[:length] + bytes(CHECKSUM_SIZE)), RECORDS), Rejection)
    assert reason(bytes(LARGEST_DATAGRAM + 1)) is Reason.OVERSIZED
    assert reason(encode_json(FRAME)[:-2] + b" " * LARGEST_DATAGRAM + b"}") is Reason.OVERSIZED


def changed(offset: int, layout: str, value: float) -> bytes:
    datagram = bytearray(encode(FRAME))
    struct.pack_into("<" + layout, datagram, offset, value)
    return resealed(bytes(datagram))


@pytest.mark.parametrize(
    "datagram, expected",
    [
        (changed(4, "B", 2), Reason.VERSION),
        (changed(5, "B", 99), Reason.KIND),
        (changed(5, "B", 201), Reason.MALFORMED),
        (changed(6, "H", 12), Reason.MALFORMED),
        (changed(8, "Q", 2**60), Reason.OUT_OF_RANGE),
        (changed(32, "d", -1.0), Reason.OUT_OF_RANGE),
        (changed(32, "d", math.nan), Reason.NON_FINITE),
        (changed(40, "f", 4.6), Reason.OUT_OF_RANGE),
        (changed(40, "f", math.inf), Reason.NON_FINITE),
        (changed(44, "B", 0), Reason.OUT_OF_RANGE),
        (changed(45, "d", math.nan), Reason.NON_FINITE),
        (encode(FRAME)[:-1] + b"\x00", Reason.CHECKSUM),
        (encode(FRAME, TOKEN), Reason.UNAUTHENTICATED),
        (b"XXXX" + encode(FRAME)[4:], Reason.FOREIGN),
        (b"", Reason.FOREIGN),
    ],
)
def test_a_wrong_value_has_its_reason(datagram, expected):
    assert reason(datagram) is expected


MEMBERS = json.loads(encode_json(FRAME))


@pytest.mark.parametrize(
    "change, expected",
    [
        ({"aoro": 2}, Reason.VERSION),
        ({"aoro": True}, Reason.VERSION),
        ({"kind": "none"}, Reason.KIND),
        ({"kind": ["probe"]}, Reason.KIND),
        ({"volts": 5.0}, Reason.OUT_OF_RANGE),
        ({"volts": math.nan}, Reason.NON_FINITE),
        ({"volts": 1e300}, Reason.NON_FINITE),
        ({"torque": 10**1000}, Reason.NON_FINITE),
        ({"gear": 1.5}, Reason.MALFORMED),
        ({"gear": math.inf}, Reason.MALFORMED),
        ({"gear": True}, Reason.MALFORMED),
        ({"gear": 10**1000}, Reason.OUT_OF_RANGE),
        ({"volts": "2.5"}, Reason.MALFORMED),
        ({"volts": None}, Reason.MALFORMED),
        ({"session": -1}, Reason.OUT_OF_RANGE),
        ({"time": math.inf}, Reason.NON_FINITE),
        ({"more": 1}, Reason.MALFORMED),
        ({"tag": "00"}, Reason.UNAUTHENTICATED),
    ],
)
def test_wrong_json_has_its_reason(change, expected):
    assert reason(json.dumps(MEMBERS | change).encode()) is expected


@pytest.mark.parametrize(
    "text", ['{"aoro": 1, "aoro": 1}', "{" * 1300, '{"aoro":' + "[" * 1300, "{}", '{"a": 1}', "{\xff"]
)
def test_broken_json_is_refused(text):
    assert reason(text.encode("latin-1")) in (Reason.MALFORMED, Reason.FOREIGN)


def test_a_member_with_a_default_may_be_left_out():
    members = {name: value for name, value in MEMBERS.items() if name != "gear"}
    found = decode(json.dumps(members).encode(), RECORDS)
    assert isinstance(found, Frame) and found.values["gear"] == 1
    assert reason(json.dumps({name: value for name, value in MEMBERS.items() if name != "volts"}).encode()) is (
        Reason.MALFORMED
    )


@pytest.mark.parametrize("encoding", [encode, encode_json])
def test_a_token_lets_in_its_owner_only(encoding):
    assert decode(encoding(FRAME, TOKEN), RECORDS, TOKEN) == FRAME
    assert reason(encoding(FRAME), TOKEN) is Reason.UNAUTHENTICATED
    assert reason(encoding(FRAME, b"another one"), TOKEN) is Reason.UNAUTHENTICATED


def test_the_receiver_drops_replays_and_other_sessions_and_counts():
    sender, receiver = Sender(TOKEN), Receiver([RECORD, OTHER], session=5, token=TOKEN, greetings=[OTHER])
    datagrams = [sender.encode(RECORD, 5, 0.1 * number, VALUES) for number in range(3)]
    assert isinstance(receiver.decode(datagrams[0]), Frame)
    assert isinstance(receiver.decode(datagrams[2]), Frame)
    for datagram in datagrams:
        found = receiver.decode(datagram)
        assert isinstance(found, Rejection) and found.reason is Reason.REPLAYED
    found = receiver.decode(sender.encode(RECORD, 6, 1.0, VALUES))
    assert isinstance(found, Rejection) and found.reason is Reason.SESSION
    found = receiver.decode(sender.encode(RECORD, 0, 1.0, VALUES))
    assert isinstance(found, Rejection) and found.reason is Reason.SESSION
    assert isinstance(receiver.decode(sender.encode(OTHER, 0, 1.0, {})), Frame)
    assert isinstance(receiver.decode(Sender(TOKEN).encode(RECORD, 5, 0.0, VALUES)), Frame)
    assert receiver.accepted == 4
    assert receiver.rejected == {Reason.REPLAYED: 3, Reason.SESSION: 2}


def test_a_refused_frame_does_not_use_up_its_number():
    receiver = Receiver([RECORD], session=11)
    assert isinstance(receiver.decode(changed(44, "B", 9)), Rejection)
    assert isinstance(receiver.decode(encode(FRAME)), Frame)


def test_senders_are_bounded(monkeypatch):
    monkeypatch.setattr(protocol, "MOST_SENDERS", 2)
    receiver = Receiver([OTHER], session=5)
    found = [receiver.decode(Sender().encode(OTHER, 5, 0.0, {})) for _ in range(3)]
    assert [isinstance(one, Frame) for one in found] == [True, True, False]


@pytest.mark.parametrize(
    "values, message",
    [
        ({"volts": 2.5, "gear": 1}, "torque"),
        (VALUES | {"more": 1.0}, "more"),
        (VALUES | {"volts": 5.0}, r"volts is 5 V, but must be in \[0.5, 4.5\] V"),
        (VALUES | {"torque": math.nan}, "torque is nan"),
    ],
)
def test_what_a_record_cannot_carry_is_not_sent(values, message):
    with pytest.raises(ValueError, match=message):
        encode(Frame(RECORD, 1, 1, 1, 0.0, values))


def test_records_are_checked():
    one = Field("x", "f32", "1", 0, 1, "x")
    for make in (
        lambda: Record("twice", 1, (one, one)),
        lambda: Record("reserved", 1, (Field("time", "f32", "1", 0, 1, "t"),)),
        lambda: Record("kind", 0, ()),
        lambda: Record("long", 1, tuple(Field(f"x{n}", "f64", "1", 0, 1, "x") for n in range(200))),
        lambda: Field("x", "f16", "1", 0, 1, "x"),
        lambda: Field("x", "f32", "1", 1, 0, "x"),
    ):
        with pytest.raises(ValueError):
            make()


def test_its_example_runs():
    assert doctest.testmod(protocol).failed == 0


def test_sizes():
    assert HEADER_SIZE == 40 and protocol.TAG_SIZE == 16 and CHECKSUM_SIZE == 4
