"""Files that are damaged at random, for the readers of ground."""

from collections.abc import Sequence

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
