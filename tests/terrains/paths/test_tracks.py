"""Tracks as messages show them."""

from aoro_gym.terrains.paths.tracks import LONGEST_NAME, display_text


def test_words_are_shown_whole_as_far_as_there_is_room():
    name = "n" * LONGEST_NAME
    assert display_text(name) == f"'{name}'"
    assert display_text(name + "nn") == f"'{name[:-1]}…'"


def test_values_are_shown_by_their_beginning_in_no_time():
    class Large(list):
        def __repr__(self):
            raise AssertionError("wrote out all of it")

    assert display_text([1.0, 2.0]) == "[1.0, 2.0]"
    assert display_text([Large()] * 1000).endswith("]")
