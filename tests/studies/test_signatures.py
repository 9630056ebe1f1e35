"""What the study of signatures makes of simulations, and of vectors whose likeness is known."""

import numpy as np
import pytest

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.validation.theory.sensitivities import Change, changes
from studies.signatures.__main__ import compared, table
from studies.signatures.likeness import SEEN, between_effects, between_families, cosines, nearest, products
from studies.signatures.responses import NOISE, REST, TICK, Responses, responses, typical


def test_no_effect_has_no_signature_and_each_effect_has_its_own(machine):
    """At size zero to the bit; in a turn of half a second to the left and back."""
    none = [
        Change(name, EFFECTS[name].magnitudes[0].name, (EFFECTS[name].none,), "") for name in ("payload", "sensor_gain")
    ]
    some = [typical(one) for one in changes() if one.effect in ("payload", "sensor_gain")]
    found = responses(machine, {"none": none, "some": some}, {1.0: (0.5, 0.3)})
    assert found.frames == (round((3 * REST + 0.8) / TICK),)
    left, right = round(REST / TICK), round((2 * REST + 0.5) / TICK)
    assert np.flatnonzero(found.turning).tolist() == [*range(left, left + 50), *range(right, right + 30)]
    assert not found.sizes["none"].any()
    payload, gain = found.sizes["some"]
    assert payload.any(axis=1).all()
    error = some[1].sizes[0][0]
    assert gain[0] == pytest.approx(error * found.nominal[0], rel=1e-9)
    assert not gain[1:].any()
    zeros = found.nuisances[-len(NOISE) :]
    assert [np.flatnonzero(one.any(axis=1)).tolist() for one in zeros] == [[0], [1], [2], [3]]


def test_typical_sizes_lie_half_way_to_the_farther_end():
    by = {one.name: typical(one).sizes[0] for one in changes()}
    assert by["payload"] == (750.0,)
    assert by["tire_relaxation"] == pytest.approx((np.sqrt(0.15),))
    assert by["back_pressure.throttle"] == (0.0, 7.5e5)


def test_cosines():
    x = np.array([[3.0, 4.0, 0.0], [6.0, 8.0, 0.0], [-4.0, 3.0, 0.0], [0.1, 0.0, 0.0]])
    cosine = cosines(products(x), SEEN)
    assert cosine[0, :3] == pytest.approx([1.0, 1.0, 0.0])
    assert np.isnan(cosine[3]).all() and np.isnan(cosine[:, 3]).all()


def test_nuisances_take_what_they_could_explain():
    """Of the metric (1 + JᵀJ)⁻¹, inverted here as it stands; a free direction leaves nothing of itself."""
    rng = np.random.default_rng(0)
    x, nuisances = rng.standard_normal((4, 30)), 3.0 * rng.standard_normal((5, 30))
    metric = np.linalg.inv(np.eye(30) + nuisances.T @ nuisances)
    assert products(x, nuisances) == pytest.approx(x @ metric @ x.T, abs=1e-11)
    free = 1e4 * np.eye(30)[:1]
    assert products(np.array([[5.0, 12.0] + [0.0] * 28]), free)[0, 0] == pytest.approx(144.0, rel=1e-6)


def test_pairs_of_families_and_confusions():
    """Two families, two effects: the second family's signatures of both are exchanged, the second one's with a minus."""
    first, second = np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])
    cosine = cosines(products(np.concatenate([first, second])), 0.0).reshape(2, 2, 2, 2)
    assert between_families(cosine) == pytest.approx(np.zeros((2, 1)))
    assert between_effects(cosine) == pytest.approx(1.0)
    one_sign, either = (nearest(cosine, np.array([way, way])) for way in (False, True))
    assert either["other"].tolist() == [[1, 0], [1, 0]]
    assert one_sign["other"].tolist() == [[-1, 0], [1, -1]]
    assert not np.nansum(either["right"])
    same = np.tile(np.eye(2), (2, 1))
    near = nearest(cosines(products(same), 0.0).reshape(2, 2, 2, 2), np.array([False, False]))
    assert between_effects(cosines(products(same), 0.0).reshape(2, 2, 2, 2)) == 0.0
    assert (near["other"] == -1).all() and np.nanmin(near["right"]) == 1.0
    hidden = np.array([[1.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    near = nearest(cosines(products(hidden), 0.5).reshape(2, 2, 2, 2), np.array([False, False]))
    assert near["other"].tolist() == [[-1, -2], [-1, -2]]
    assert np.isnan(near["right"][0, 1]).tolist() == [False, True]


def test_the_comparison_of_families_that_are_alike_and_of_one_that_is_not():
    wanted = [one for one in changes() if one.effect in ("payload", "sensor_gain", "tire_scrub")]
    rng, frames = np.random.default_rng(1), 200
    parts = [30.0 * rng.standard_normal((count, 4, frames)) for count in (1, 3, 1, 3)]
    turning = np.arange(frames) < 150

    def family(typical_ones, turning=turning):
        sizes = {"typical": typical_ones, "small": 0.01 * parts[1]}
        return Responses(parts[0][0], sizes, 0.1 * parts[2], 1e-6 * parts[0][0], (frames,), turning)

    alike = compared(["a", "b"], [family(parts[1]), family(parts[1])], wanted)
    for row in alike["summary"]:
        assert row["median"] == pytest.approx(1.0, abs=1e-9)
        assert (row["confused"], row["pairs"], row["effects_of_families"]) == (0, 3, 6)
    turned_over = np.where(turning, parts[1], -parts[1])  # alike while turning alone
    other = compared(["a", "b"], [family(parts[1]), family(turned_over)], wanted)
    by = {(row["size"], row["view"], row["nuisances_removed"], row["channels"]): row for row in other["summary"]}
    assert by["typical", "turning", False, "all"]["median"] == pytest.approx(1.0)
    assert 0.3 < by["typical", "whole", False, "all"]["median"] < 0.7  # (150 - 50)/200 on the average
    never = compared(["a", "b"], [family(parts[1]), family(1e-5 * parts[3])], wanted)
    row = next(row for row in never["summary"] if row["size"] == "typical")
    assert row["pairs"] == 0 and np.isnan(row["median"])
    text = table(alike)
    assert all(f"| {one.name} |" in text for one in wanted) and " | 1.00 to 1.00 | 0 of 3 | 0 of 6 | 100 % |" in text
