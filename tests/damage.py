"""Files that are damaged at random, for readers that must read or refuse them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st


@st.composite
def damaged(draw: st.DrawFn, seeds: Sequence[bytes], tokens: Sequence[bytes]) -> bytes:
    """One of ``seeds`` with up to six places cut, copied, overwritten or filled in, every other one within the header;
    ``tokens`` are what is written."""
    data = bytearray(draw(st.sampled_from(seeds)))
    for _ in range(draw(st.integers(1, 6))):
        start = draw(st.integers(0, len(data) if draw(st.booleans()) else min(len(data), 400)))
        size = draw(st.sampled_from((0, 1, 2, 4, 8, 60, 400)))
        how = draw(st.sampled_from(("over", "over", "token", "bit", "byte", "cut", "copy")))
        if how in ("token", "over"):
            token = draw(st.sampled_from(tokens))
            data[start : start + (len(token) if how == "over" else size)] = token
        elif how == "bit" and start < len(data):
            data[start] ^= 1 << draw(st.integers(0, 7))
        elif how == "byte":
            data[start : start + 1] = draw(st.binary(min_size=1, max_size=2))
        elif how == "cut":
            del data[start : start + size]
        else:
            data[start:start] = data[start : start + size] * 3
    return bytes(data)


def fuzz(answer: Callable[[bytes], Any], seeds: Sequence[bytes], tokens: Sequence[bytes], examples: int) -> None:
    """Call ``answer`` with so many damaged files, always the same ones."""
    checks = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example]
    bounds = settings(
        max_examples=examples, deadline=None, database=None, derandomize=True, suppress_health_check=checks
    )
    bounds(given(damaged(seeds, tokens))(answer))()


def assert_refusal(error: ValueError, file: Path) -> None:
    """Everybody is refused alike: in one printable line that begins with the file and does not repeat it."""
    message = str(error)
    assert message.startswith(str(file)), message
    assert "\n" not in message
    assert message.isprintable(), message
    assert len(message) < len(str(file)) + 700, message
