"""Plants that teach networks: cases come from their file as they were, and families that are left out are never drawn."""

from __future__ import annotations

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.forward import TRAINED, networks_in, trained
from aoro_gym.diagnosis.simulation.manoeuvres import CHANNELS, SAMPLES
from aoro_gym.diagnosis_benchmark import component_families
from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.execution.files import write_json
from studies.development.cases import COMPONENT, INDEPENDENT, LAYERED
from studies.development.teachers import families_in, teachers, told_of, unbiased

torch = pytest.importorskip("torch")

from aoro_gym.diagnosis.network.sensing import Draw  # noqa: E402
from aoro_gym.diagnosis.network.training import Course  # noqa: E402
from studies.cross_fitting.__main__ import (  # noqa: E402
    LEFT_OUT,
    SUITE,
    between,
    mixtures,
    scaled,
    shares_of,
    starts_in,
    taught_by,
    teaching,
)
from studies.cross_fitting.plants import MIXED_SUITE, cut, load  # noqa: E402

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
    shares = shares_of(["alder", "birch", "cedar"], ["birch"], 0.4)
    assert shares == {0: 0.5, 2: 0.5}
    batch = taught_by(recorded, shares, course)(128, draw)
    assert not torch.any(batch.effects == 1)
    singles = batch.effects[:, 0]
    assert int((singles == 0).sum()) > 0 and int((singles == 2).sum()) > 0
    assert batch.rows.shape[1] == course.logs and not torch.any(batch.present[:, LOGS:])
    assert torch.all(batch.present[:, 0]) and torch.all(torch.isfinite(batch.rows))
    assert torch.all(torch.isnan(batch.sizes))


def test_families_teach_as_often_as_their_shares(recorded) -> None:
    course, draw = Course(batch=1024), Draw(torch.Generator().manual_seed(2))
    batch = taught_by(recorded, {0: 0.7, 2: 0.3}, course)(1024, draw)
    singles = batch.effects[:, 0]
    share = float((singles == 0).sum() / (singles >= 0).sum())
    assert share == pytest.approx(0.7, abs=4 * np.sqrt(0.7 * 0.3 / 600))  # four of five cases have an effect


def test_every_family_is_left_out_by_one_network() -> None:
    names = [one.name for one in (*INDEPENDENT, *COMPONENT, *LAYERED)]
    assert sorted(name for some in LEFT_OUT for name in some) == sorted(names)


def test_a_network_learns_from_no_part_of_what_it_leaves_out() -> None:
    names = [one.name for one in teaching("cpu", 3)]
    families = len(INDEPENDENT) + len(LAYERED) + len(component_families.FAMILIES)
    assert len(names) == len(set(names)) == families + 3 * len(LEFT_OUT)
    for left_out in LEFT_OUT:
        shares = shares_of(names, left_out, 0.4)
        taught = [names[number] for number in shares]
        assert not families_in(taught) & set(left_out)
        assert families_in(taught) | set(left_out) == families_in(names)
        assert {name for name in taught if name.startswith("mixed")} == set(mixtures(left_out, 3))
        assert sum(shares.values()) == pytest.approx(1.0)
        assert sum(shares[number] for number in shares if names[number].startswith("mixed")) == pytest.approx(0.4)


def test_a_family_is_asked_of_networks_that_never_saw_it() -> None:
    """Of the shipped ones: each family by the one that left it out; what teaches all of them is asked of none."""
    for file, some in zip(networks_in(TRAINED), LEFT_OUT, strict=True):
        assert all(unbiased(TRAINED, name) == [file] for name in some)
    with pytest.raises(ValueError, match="oak has taught all networks"):
        unbiased(TRAINED, "oak")


def test_networks_before_component_families_never_saw_them(tmp_path) -> None:
    """What is told of them is what they left out of the families that there were."""
    write_json(tmp_path / "training.json", {"networks": [{"file": "network_0.safetensors", "left_out": ["alder"]}]})
    assert all(unbiased(tmp_path, one.name) == [tmp_path / "network_0.safetensors"] for one in COMPONENT)


def test_a_family_that_has_taught_all_networks_is_not_asked(tmp_path) -> None:
    told = [{"file": "network_0.safetensors", "left_out": ["fir"], "taught": ["alder", "mixed_elm_hazel_0003"]}]
    write_json(tmp_path / "training.json", {"networks": told})
    assert teachers(told[0]) == {"alder", "elm", "hazel"} and told_of(tmp_path) == told
    assert unbiased(tmp_path, "fir") == unbiased(tmp_path, "birch") == [tmp_path / "network_0.safetensors"]
    with pytest.raises(ValueError, match="hazel has taught all networks"):
        unbiased(tmp_path, "hazel")


def test_a_manoeuvre_is_simulated_as_far_as_it_is_shown() -> None:
    turn = Excitation("left_50", -0.9, np.r_[np.zeros(70), np.full(860, 0.5)])
    assert len(cut(turn).steering) == 70 + SAMPLES
    drive = Excitation("drive", 0.0, np.zeros(700), np.r_[np.zeros(40), np.full(660, 0.2)])
    assert len(cut(drive).drive) == len(cut(drive).steering) == 40 + SAMPLES  # type: ignore[arg-type]
    whole = Excitation("pulse", 0.0, np.r_[np.zeros(70), np.full(200, 0.5)])
    np.testing.assert_array_equal(cut(whole).steering, whole.steering)


def test_a_suite_is_tried_out_with_some_of_each_kind() -> None:
    small = scaled(MIXED_SUITE, 0.001)
    assert (small.healthy, small.singles, small.pairs, small.outside) == (1, 1, 1, 1)
    assert scaled(SUITE, 1.0) == SUITE


def test_a_network_between_two_others_has_weights_between_theirs():
    start, end = trained()[:2]
    found = between(start, end, 0.25)
    for name, values in found.arrays.items():
        np.testing.assert_allclose(values, 0.25 * start.arrays[name] + 0.75 * end.arrays[name], rtol=1e-5, atol=1e-6)
        assert values.dtype == np.float32
    np.testing.assert_allclose(found.scales, 0.25 * start.scales + 0.75 * end.scales)
    for kept, whole in ((0.0, end), (1.0, start)):
        assert all(np.array_equal(between(start, end, kept).arrays[n], v) for n, v in whole.arrays.items())


def test_training_goes_on_from_networks_that_what_is_left_out_has_not_taught(tmp_path):
    """The shipped ones left out what is left out now, each its own."""
    assert starts_in(TRAINED) == list(networks_in(TRAINED))
    for network in networks_in(TRAINED):
        (tmp_path / network.name).symlink_to(network)
    assert len(starts_in(tmp_path)) == len(LEFT_OUT)  # nothing is told: no plants have taught them
    files = [one.name for one in networks_in(TRAINED)]
    taught = [
        {"file": name, "left_out": list(some), "taught": ["oak"]} for name, some in zip(files, LEFT_OUT, strict=True)
    ]
    write_json(tmp_path / "training.json", {"networks": taught[::-1]})
    assert [one.name for one in starts_in(tmp_path)] == [files[-1]] * 3  # each may be any
    for one, some in zip(taught, LEFT_OUT, strict=True):
        one["taught"] = [name for others in LEFT_OUT for name in others if name not in some]
    write_json(tmp_path / "training.json", {"networks": taught[::-1]})
    assert [one.name for one in starts_in(tmp_path)] == files
    taught[0]["taught"] = ["mixed_elm_hazel_0001"]
    write_json(tmp_path / "training.json", {"networks": taught})
    with pytest.raises(ValueError, match=r"some of alder, elm, .* have taught each network"):
        starts_in(tmp_path)
