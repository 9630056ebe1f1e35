"""Messages of the checks of arguments."""

import math

import numpy as np
import pytest

from aoro_gym.checks import check_choice, check_finite, check_integer, check_range, printable


@pytest.mark.parametrize(
    ("value", "bounds", "message"),
    [
        (1.5, {"ge": 0.0, "le": 1.0}, "x is 1.5 s, but must be in [0, 1] s"),
        (0.0, {"gt": 0.0, "lt": 1.0}, "x is 0 s, but must be in (0, 1) s"),
        (1.0, {"ge": 0.0, "lt": 1.0}, "x is 1 s, but must be in [0, 1) s"),
        (-1, {"ge": 0.0}, "x is -1 s, but must be at least 0 s"),
        (0, {"gt": 0.0}, "x is 0 s, but must be above 0 s"),
        (3, {"le": 2.0}, "x is 3 s, but must be at most 2 s"),
        (2, {"lt": 2.0}, "x is 2 s, but must be below 2 s"),
        (math.inf, {"gt": 0.0, "lt": math.inf}, "x is inf s, but must be finite and above 0 s"),
        (math.nan, {"ge": 0.0}, "x is nan s, but must be at least 0 s"),
        (1.0000001, {"le": 1.0}, "x is 1.0000001 s, but must be at most 1 s"),
        (3 * 0.4, {"le": 1.0}, "x is 1.2 s, but must be at most 1 s"),
        (np.float32(1.1), {"le": 1.0}, "x is 1.1 s, but must be at most 1 s"),
        ([0.5, 2.0, 3.0], {"le": 1.0}, "x[1] is 2 s, but must be at most 1 s"),
        (np.array([[0.5], [np.nan]]), {"le": 1.0}, "x[1, 0] is nan s, but must be at most 1 s"),
    ],
)
def test_value_out_of_its_range_is_named_with_it(value, bounds, message):
    with pytest.raises(ValueError) as raised:
        check_range("x", value, "s", **bounds)
    assert str(raised.value) == message


@pytest.mark.parametrize(
    ("value", "bounds"),
    [
        (0.0, {"ge": 0.0}),
        (1.0, {"ge": 0.0, "le": 1.0}),
        (math.inf, {"gt": 0.0}),
        ([], {"gt": 0.0}),
        ([1, 2], {"lt": 3}),
    ],
)
def test_values_within_their_range_pass(value, bounds):
    check_range("x", value, **bounds)


def test_other_kinds_of_error_and_notes_serve():
    with pytest.raises(UnicodeError, match=r"x is 1, but must be below 0: too hot$"):
        check_range("x", 1, lt=0.0, note=": too hot", error=UnicodeError)


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, [0.0, math.inf]])
def test_numbers_that_are_not_finite_are_named(value):
    check_finite("x", [0.0, -1e300])
    with pytest.raises(ValueError, match=r"is -?(inf|nan) m, but must be finite$"):
        check_finite("x", value, "m")


@pytest.mark.parametrize(
    ("value", "bounds", "message"),
    [
        (0, {}, "n is 0, but must be a positive integer"),
        (1.0, {}, "n is 1.0, but must be a positive integer"),
        (True, {}, "n is True, but must be a positive integer"),
        (1, {"ge": 2}, "n is 1, but must be an integer of at least 2"),
        (5, {"le": 4}, "n is 5, but must be an integer in [1, 4]"),
    ],
)
def test_what_is_no_integer_of_its_range_is_named_with_it(value, bounds, message):
    check_integer("n", np.int64(3), **bounds)
    with pytest.raises(ValueError) as raised:
        check_integer("n", value, **bounds)
    assert str(raised.value) == message


def test_what_is_no_choice_is_named_with_the_choices():
    check_choice("kind", "b", ("a", "b"))
    with pytest.raises(ValueError) as raised:
        check_choice("kind", "c", ("a", "b"))
    assert str(raised.value) == "kind is 'c'; choose one of: a, b"


def test_what_a_terminal_would_obey_is_marked():
    assert printable("l\tt, \x1b[2K, °ä") == "l\ufffdt, \ufffd[2K, °ä"


def test_long_values_are_echoed_in_part():
    with pytest.raises(ValueError, match=r"^x is '0{56}\.\.\., but must be a positive integer$"):
        check_integer("x", "0" * 10_000)
    with pytest.raises(ValueError, match=r"^x is '0{56}\.\.\.; choose one of: a, b$"):
        check_choice("x", "0" * 10_000, ("a", "b"))
