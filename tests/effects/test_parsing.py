"""Effects of the command line, and what is wrong with others."""

import pytest

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.parsing import parse_effect


def test_an_effect_and_its_magnitudes():
    assert parse_effect("--effect", "seal_friction=3e3", EFFECTS) == (EFFECTS["seal_friction"], [3000.0])
    effect, magnitudes = parse_effect("--effect", "ground_slope=0.1, -0.05", EFFECTS)
    assert (effect.id, magnitudes) == ("ground_slope", [0.1, -0.05])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gremlins=1", "--effects gremlins=1: 'gremlins' is no effect here; choose from: payload"),
        ("payload", "--effects payload is not payload=MASS, numbers in SI"),
        ("payload=much", "payload=much is not payload=MASS"),
        ("payload=1,2", "payload=1,2 is not payload=MASS"),
        ("payload=nan", "payload=nan is not payload=MASS"),
        ("payload=1e9", r"--effects payload: mass is 1000000000 kg, but must be in \[0, 1500\] kg"),
    ],
)
def test_what_is_wrong_is_named(text, message):
    with pytest.raises(ValueError, match=message):
        parse_effect("--effects", text, {"payload": EFFECTS["payload"]})
