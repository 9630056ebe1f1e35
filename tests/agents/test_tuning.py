"""Tuning improves on a random draw, and repeats."""

from aoro_gym.agents import tuning


def test_tuning_repeats_and_keeps_to_its_bounds():
    best = []
    gains = [
        tuning.tune(
            "bang-bang",
            population=5,
            generations=1,
            episodes=1,
            steps=60,
            progress=lambda generation, value: best.append(value),
        )
        for _ in range(2)
    ]
    assert gains[0] == gains[1]
    assert best[:2] == best[2:]
    assert best[1] >= best[0]
    for name, (low, high) in tuning.CONTROLLERS["bang-bang"].bounds.items():
        assert low <= gains[0][name] <= high
