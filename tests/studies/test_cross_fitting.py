"""Plants that teach networks: cases come from their file as they were, and families that are left out are never drawn."""

from __future__ import annotations

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.forward import TRAINED, networks_in, trained
from aoro_gym.diagnosis.simulation.manoeuvres import CHANNELS, SAMPLES
from aoro_gym.execution.files import write_json
from studies.development.cases import INDEPENDENT, LAYERED

torch = pytest.importorskip("torch")

from aoro_gym.diagnosis.network.sensing import Draw  # noqa: E402
from aoro_gym.diagnosis.network.training import Course  # noqa: E402
from studies.cross_fitting.__main__ import LEFT_OUT, between, starts_in, taught_by  # noqa: E402
from studies.cross_fitting.plants import load  # noqa: E402
from studies.development.__main__ import unbiased  # noqa: E402

COUNT, LOGS = 5, 4


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory):
    """Three families of made-up cases, whose single effect is the family's number."""
    folder, paths = tmp_path_factory.mktemp("teaching"), []
    for family in range(3):
        rng = np.random.default_rng(family)
        effects = np.tile([family, -1], (COUNT, 1))
        effects[0] = -1  # nothing is wrong
        path = folder / f"{family}.npz"
        np.savez(
            path,
            samples=rng.integers(-9, 9, (COUNT, LOGS, 2, len(CHANNELS), SAMPLES), dtype=np.int16),
            commands=np.zeros((COUNT, LOGS, 2, SAMPLES), dtype=np.float32),
            effects=effects,
            outside=np.arange(COUNT) == COUNT - 1,
        )
        paths.append(path)
    return load(paths, "cpu")


def test_cases_keep_what_is_wrong_with_them(recorded) -> None:
    assert recorded.family.tolist() == sorted([0, 1, 2] * COUNT)
    assert recorded.hypothesis[:COUNT].tolist() == [
        hypotheses.NOTHING, *[hypotheses.SINGLE] * (COUNT - 2), hypotheses.OUTSIDE
    ]  # fmt: skip


def test_a_family_that_is_left_out_teaches_nothing(recorded) -> None:
    course, draw = Course(batch=128), Draw(torch.Generator().manual_seed(1))
    batch = taught_by(recorded, ["a", "b", "c"], ["b"], course)(128, draw)
    assert not torch.any(batch.effects == 1)
    singles = batch.effects[:, 0]
    assert int((singles == 0).sum()) > 0 and int((singles == 2).sum()) > 0
    assert batch.rows.shape[1] == course.logs and not torch.any(batch.present[:, LOGS:])
    assert torch.all(batch.present[:, 0]) and torch.all(torch.isfinite(batch.rows))
    assert torch.all(torch.isnan(batch.sizes))


def test_every_family_is_left_out_by_one_network() -> None:
    names = [one.name for one in (*INDEPENDENT, *LAYERED)]
    assert sorted(name for some in LEFT_OUT for name in some) == sorted(names)
    for number, some in enumerate(LEFT_OUT):
        for name in some:
            assert [path.name for path in unbiased(name)] == [f"network_{number}.safetensors"]


def test_a_network_between_two_others_has_weights_between_theirs():
    start, end = trained()[:2]
    found = between(start, end, 0.25)
    for name, values in found.arrays.items():
        np.testing.assert_allclose(values, 0.25 * start.arrays[name] + 0.75 * end.arrays[name], rtol=1e-5, atol=1e-6)
        assert values.dtype == np.float32
    np.testing.assert_allclose(found.scales, 0.25 * start.scales + 0.75 * end.scales)
    for kept, whole in ((0.0, end), (1.0, start)):
        assert all(np.array_equal(between(start, end, kept).arrays[n], v) for n, v in whole.arrays.items())


def test_training_goes_on_from_networks_that_left_out_the_same_families_only(tmp_path):
    assert starts_in(TRAINED) == list(networks_in(TRAINED))
    for network in networks_in(TRAINED):
        (tmp_path / network.name).symlink_to(network)
    assert len(starts_in(tmp_path)) == len(LEFT_OUT)  # nothing is told: no plants have taught them
    others = [{"file": one.name, "left_out": ["alder"]} for one in networks_in(TRAINED)]
    write_json(tmp_path / "training.json", {"networks": others})
    with pytest.raises(ValueError, match="left out other families"):
        starts_in(tmp_path)
