"""A detector for logs: what it is taught, what it tells and how that is scored; the commands that a user types."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

torch = pytest.importorskip("torch")

from aoro_gym.sensors.dataset import FACTORS  # noqa: E402
from studies.log_detection import scoring, study  # noqa: E402
from studies.log_detection.__main__ import main  # noqa: E402
from studies.log_detection.detector import Detector, _told, cells, loss, padded, targets, train, varied  # noqa: E402
from studies.log_detection.figures import differences, failure  # noqa: E402
from studies.log_detection.keeping import Keeping  # noqa: E402
from studies.log_detection.making import forest_sets  # noqa: E402
from studies.log_detection.pictures import CANVAS, CLASSES, Pictures, load  # noqa: E402
from studies.log_detection.scale import SCALES  # noqa: E402
from studies.log_detection.scoring import score, told  # noqa: E402

pytestmark = pytest.mark.filterwarnings(
    "ignore:__array__ implementation:DeprecationWarning"
)  # pycocotools with numpy 2

COLOURS = {"trunk": (200, 60, 40), "log": (40, 190, 60), "stump": (50, 60, 210)}
"""Of rectangles that stand for objects."""
SIZES = {"trunk": (14, 60), "log": (60, 16), "stump": (24, 24)}


def drawn(folder, count: int, *, seed: int = 0, size: tuple[int, int] = CANVAS, name: str = "log"):
    """A COCO file of pictures of coloured rectangles on noise, which is returned; ``name`` is the class log's."""
    rng = np.random.default_rng(seed)
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    (folder / "images").mkdir(parents=True)
    for number in range(count):
        pixels = rng.integers(90, 150, (*size, 3), dtype=np.uint8)
        for kind, (width, height) in SIZES.items():
            x, y = int(rng.integers(size[1] - width)), int(rng.integers(size[0] - height))
            pixels[y : y + height, x : x + width] = COLOURS[kind]
            one = {"id": len(annotations) + 1, "image_id": number, "category_id": 10 + CLASSES.index(kind)}
            annotations.append({**one, "bbox": [x, y, width, height], "area": width * height, "iscrowd": 0})
        Image.fromarray(pixels).save(folder / "images" / f"{number}.png")
        images.append({"id": number, "file_name": f"{number}.png", "height": size[0], "width": size[1]})
    categories = [{"id": 10 + at, "name": name if one == "log" else one} for at, one in enumerate(CLASSES)]
    file = folder / "annotations.json"
    file.write_text(json.dumps({"images": images, "annotations": annotations, "categories": categories}))
    return file


@pytest.fixture(scope="module")
def rectangles(tmp_path_factory) -> Pictures:
    folder = tmp_path_factory.mktemp("rectangles")
    return load(drawn(folder, 12), folder / "images")


def as_told(pictures: Pictures, scores: float = 0.9) -> list[np.ndarray]:
    """The truth as a detector would tell it."""
    return [
        np.column_stack([boxes, np.full(len(boxes), scores), labels]).astype(np.float32)
        for boxes, labels in zip(pictures.boxes, pictures.labels, strict=True)
    ]


def test_pictures_of_other_shapes_keep_their_boxes(tmp_path) -> None:
    """Boxes shrink with their picture: on the canvas they still lie on their rectangles' colour."""
    found = load(drawn(tmp_path, 2, size=(300, 320), name="Timber"), tmp_path / "images", renamed={"log": "Timber"})
    assert found.scales == pytest.approx(144 / 300)
    assert np.all(found.pixels[:, :, round(320 * 144 / 300) :] == 114)
    for number in range(2):
        at = CLASSES.index("log")
        (box,) = found.boxes[number][found.labels[number] == at]
        x, y = (0.5 * (box[:2] + box[2:])).astype(int)
        assert box[2] - box[0] == pytest.approx(60 * 144 / 300)
        assert int(np.argmax(found.pixels[number, y, x].astype(int))) in (0, 1, 2)
    assert found.truth["annotations"][0]["bbox"][2] in {width for width, _ in SIZES.values()}


def test_cells_that_learnt_their_targets_tell_the_truth(rectangles) -> None:
    """What the cells are to learn, told by a network that has learnt it, is every box to the pixel."""
    boxes, labels = padded(rectangles.boxes, rectangles.labels)
    boxes, labels = torch.nn.functional.pad(boxes, (0, 0, 0, 2)), torch.nn.functional.pad(labels, (0, 2), value=-1)
    heat, edges, weights = targets(boxes, labels, len(CLASSES), CANVAS)
    at = cells(CANVAS)
    assert weights.sum(dim=(1, 2)) == pytest.approx([len(one) for one in rectangles.boxes], abs=1e-4)
    distances = torch.cat([at - edges[:, :2], edges[:, 2:] - at], dim=1)
    for number, own in enumerate(rectangles.boxes):
        found = _told(heat[number], torch.where(weights[number] > 0, distances[number], 1.0))
        sure = found[found[:, 4] > 0.999]
        assert len(sure) >= len(own)
        for box, label in zip(own, rectangles.labels[number], strict=True):
            apart = np.abs(sure[sure[:, 5] == label, :4] - box).max(axis=1)
            assert apart.min() < 1e-3
    logits = torch.logit(heat.clamp(1e-6, 1.0 - 1e-6))
    good = loss(logits, distances.clamp(min=0.1), (heat, edges, weights)).item()
    assert good < 0.05 * loss(torch.zeros_like(logits), distances.clamp(min=0.1), (heat, edges, weights)).item()
    assert good < loss(logits, 2.0 * distances.clamp(min=0.1), (heat, edges, weights)).item() - 0.3


def test_boxes_move_with_their_pictures() -> None:
    """A bright rectangle, mirrored, shifted and scaled, lies where its box does, to a pixel of interpolation."""
    pixels = torch.zeros(32, 3, *CANVAS)  # what fills the canvas beside moved pictures, too
    pixels[:, :, 50:90, 20:70] = 1.0
    given = torch.tensor([[20.0, 50.0, 70.0, 90.0], [-40.0, 0.0, 10.0, 9.0]]).expand(32, 2, 4)
    labels = torch.tensor([2, 1]).expand(32, 2)
    moved, boxes, kept = varied(pixels, given, labels, torch.Generator().manual_seed(3))
    assert bool((kept[:, 0] == 2).all()) and set(kept[:, 1].tolist()) == {
        -1,
        1,
    }  # a fifth of the other is in the picture
    boxes = boxes[:, :1]
    for picture, (own,) in zip(moved[:, 1], boxes, strict=True):
        rows, columns = torch.nonzero(picture > 0.5 * (picture.min() + picture.max()), as_tuple=True)
        seen = torch.stack([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        assert torch.abs(seen - own).max() < 1.5
    middles = torch.stack([own[0, 0] + own[0, 2] for own in boxes]) / 2
    assert 8 < int((middles > CANVAS[1] / 2).sum()) < 24  # half of them are mirrored


def test_truth_scores_one_and_pycocotools_says_the_same(rectangles, monkeypatch, capsys) -> None:
    made = Detector().eval()
    monkeypatch.setattr(scoring, "detect", lambda *_: as_told(rectangles))
    whole = score(made, rectangles, resamples=5)
    assert whole["ap50"]["log"] == [pytest.approx(1.0)] * 3 and whole["ap50"]["log_end"] is None
    assert whole["ap50"]["mean"][0] == pytest.approx(1.0)
    assert whole["boxes"] == {"trunk": 12, "log": 12, "log_end": 0, "stump": 12}
    rng = np.random.default_rng(1)
    rough = [
        one + np.array([*rng.normal(0.0, 6.0, 4), rng.normal(0.0, 0.2), 0.0], np.float32) for one in as_told(rectangles)
    ]
    monkeypatch.setattr(scoring, "detect", lambda *_: rough)
    found = score(made, rectangles, resamples=40)["ap50"]["mean"]
    truth: Any = COCO()
    truth.dataset = rectangles.truth
    truth.createIndex()
    run: Any = COCOeval(truth, truth.loadRes(told(made, rectangles)), "bbox")
    run.evaluate()
    run.accumulate()
    run.summarize()
    assert found[0] == pytest.approx(run.stats[1], abs=1e-9)  # AP50
    assert 0.0 < found[1] < found[0] < found[2] <= 1.0
    capsys.readouterr()


def test_intervals_are_those_of_forests(rectangles, monkeypatch) -> None:
    """Twelve pictures of two forests, all found in one and none in the other, may be twice one or the other; each of its own
    forest, they are never all alike."""
    half = [one if at < 6 else one[:0] for at, one in enumerate(as_told(rectangles))]
    monkeypatch.setattr(scoring, "detect", lambda *_: half)
    widths = []
    for of_forest in (6, 1):
        images = [{**one, "world_seed": at // of_forest} for at, one in enumerate(rectangles.truth["images"])]
        grouped = replace(rectangles, truth={**rectangles.truth, "images": images})
        _, low, high = score(Detector().eval(), grouped, resamples=100)["ap50"]["mean"]
        widths.append((low, high))
    assert widths[0] == (0.0, pytest.approx(1.0)) and widths[1][0] > 0.0 and widths[1][1] < 1.0


def test_what_is_hardly_seen_counts_neither_way(tmp_path, monkeypatch) -> None:
    """Of three logs one is tiny and one is hidden to nine tenths: missing both costs nothing, and so does finding them."""
    file = drawn(tmp_path, 3)
    whole = json.loads(file.read_text())
    logs = [one for one in whole["annotations"] if one["category_id"] == 10 + CLASSES.index("log")]
    logs[0]["area"], logs[1]["occlusion"] = 20, 0.9
    file.write_text(json.dumps(whole))
    pictures = load(file, tmp_path / "images")
    assert [len(one) for one in pictures.boxes] == [3, 3, 3]  # all are learnt
    log = CLASSES.index("log")
    fewer = [one if at == 2 else one[one[:, 5] != log] for at, one in enumerate(as_told(pictures))]
    for found in (fewer, as_told(pictures)):
        monkeypatch.setattr(scoring, "detect", lambda *_, found=found: found)
        result = score(Detector().eval(), pictures, resamples=2)
        assert result["ap50"]["log"][0] == pytest.approx(1.0) and result["boxes"]["log"] == 1


def test_the_worst_failures_are_found(rectangles) -> None:
    found = as_told(rectangles)
    stump, log = CLASSES.index("stump"), CLASSES.index("log")
    found[3] = found[3][found[3][:, 5] != log]  # one log is missed
    found[5] = np.vstack([found[5], np.array([[0, 0, 3, 3, 0.8, stump]], np.float32)])  # a stump where nothing is
    missed = failure(rectangles, found, log, True, set())
    false = failure(rectangles, found, stump, False, set())
    assert missed is not None and missed[0] == 3
    assert false is not None and false[0] == 5 and false[1].tolist() == [0, 0, 3, 3]
    assert failure(rectangles, found, log, True, {3}) is None


def test_commands_train_score_and_tune(tmp_path, capsys) -> None:
    """From COCO files to a detector, its scores, its boxes and a sheet; the same seed is the same detector."""
    torch.set_num_threads(1)
    file = drawn(tmp_path / "set", 4)
    words = ["--images", str(file.parent / "images"), "--quiet"]
    for name, more in (("a", []), ("b", []), ("c", ["--start", str(tmp_path / "a")]), ("d", ["--seed", "1"])):
        assert main(["train", str(file), *words, "--out", str(tmp_path / name), "--steps", "3", *more]) == 0
    assert (
        main(["train", str(file), *words, "--out", str(tmp_path / "e"), "--steps", "2", "--width", "64", "--wide", "2"])
        == 0
    )
    assert (Detector.load(tmp_path / "e").canvas, Detector.load(tmp_path / "e").wide) == ((48, 64), 2)
    weights = {name: Detector.load(tmp_path / name).state_dict()["scores.1.weight"] for name in "abcd"}
    assert torch.equal(weights["a"], weights["b"])
    assert not torch.equal(weights["a"], weights["c"]) and not torch.equal(weights["a"], weights["d"])
    places = [tmp_path / name for name in ("score.json", "told.json", "sheet.png")]
    options = ["--json", str(places[0]), "--told", str(places[1]), "--sheet", str(places[2])]
    assert main(["score", str(tmp_path / "a"), str(file), *words, *options]) == 0
    assert set(json.loads(places[0].read_text())["ap50"]) == {*CLASSES, "mean"}
    assert isinstance(json.loads(places[1].read_text()), list)
    assert "4 pictures" in capsys.readouterr().out
    with Image.open(places[2]) as opened:
        assert opened.width == 3 * 2 * CANVAS[1]


def test_a_training_that_was_interrupted_goes_on_to_the_same_detector(rectangles, tmp_path) -> None:
    """Stopped after three of six batches; a training of another course begins anew, and so does one whose file is broken."""
    torch.set_num_threads(1)
    whole = train(rectangles, steps=6, batch=4)
    file, told = tmp_path / "training.kept", []

    def stop(done: int, detector: Detector) -> None:
        told.append(done)
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(rectangles, steps=6, batch=4, keeping=Keeping(file, 0.0, stop))
    again = train(rectangles, steps=6, batch=4, keeping=Keeping(file, 0.0, lambda done, _: told.append(done)))
    assert told == [1, 2, 3, 4, 5, 6]
    for name, value in whole.state_dict().items():
        assert torch.equal(value, again.state_dict()[name])
    told.clear()
    train(rectangles, steps=6, batch=4, seed=1, keeping=Keeping(file, 0.0, lambda done, _: told.append(done)))
    file.write_bytes(file.read_bytes()[:1000])
    train(rectangles, steps=2, batch=4, keeping=Keeping(file, 0.0, lambda done, _: told.append(done)))
    assert told == [1, 2, 3, 4, 5, 6, 1, 2]


def test_a_training_that_is_not_done_has_scores(rectangles, tmp_path) -> None:
    one = study.Training("scratch", "other", 5, 0, 100)
    sets: Any = {"other_test": rectangles}
    study._tell_partly(one, tmp_path, sets, "cpu", 40, Detector().eval())
    found = json.loads((tmp_path / "partial" / f"{one.name}.json").read_text())
    assert (found["done"], found["steps"]) == (40, 100) and set(found["scores"]["other_test"]["ap50"]) == {
        *CLASSES,
        "mean",
    }
    assert not study._is_there(one, tmp_path)


def test_pictures_are_read_once(tmp_path) -> None:
    """From the file that is kept; a picture that is newer is read again."""
    file, kept = drawn(tmp_path, 3), tmp_path / "kept.npy"
    first = load(file, tmp_path / "images", kept=kept).pixels
    np.testing.assert_array_equal(first, load(file, tmp_path / "images").pixels)
    began = kept.stat().st_mtime_ns
    load(file, tmp_path / "images", kept=kept)
    assert kept.stat().st_mtime_ns == began
    Image.new("RGB", (CANVAS[1], CANVAS[0]), "white").save(tmp_path / "images/1.png")
    os.utime(tmp_path / "images/1.png", ns=(began + 10**9, began + 10**9))
    assert (load(file, tmp_path / "images", kept=kept).pixels[1] == 255).all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["score", "{set}", "{set}", "--images", "."], "holds no detector"),
        (["train", "{set}", "--images", "nowhere", "--out", "x"], "there is no picture nowhere/0.png"),
        (["train", "{set}", "--images", ".", "--out", "x", "--steps", "0"], "--steps is 0, but must be at least 2"),
        (
            ["train", "{set}", "--images", ".", "--out", "x", "--width", "70"],
            "--width is 70, but must be a multiple of 16",
        ),
        (
            ["train", "{set}", "--images", ".", "--out", "x", "--name", "tree=Tree"],
            "--name is 'tree=Tree', but must be",
        ),
        (
            ["train", "{none}", "--images", ".", "--out", "x"],
            "has none of the classes trunk, log, log_end, stump, but car",
        ),
        (["train", "{list}", "--images", ".", "--out", "x"], "it is no file of COCO"),
    ],
)
def test_wrong_input(tmp_path, monkeypatch, capsys, words, message) -> None:
    monkeypatch.chdir(tmp_path)
    files = {"set": drawn(tmp_path / "set", 1), "none": tmp_path / "none.json", "list": tmp_path / "list.json"}
    files["none"].write_text(json.dumps({"images": [], "annotations": [], "categories": [{"id": 1, "name": "car"}]}))
    files["list"].write_text("[]")
    assert main([word.format(**files) for word in words]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("scale", SCALES)
def test_no_forest_is_learnt_and_scored_and_sets_differ_in_what_is_fixed_alone(scale) -> None:
    made = forest_sets(SCALES[scale])
    seeds = {name: set(range(one.seed, one.seed + one.worlds)) for name, one in made.items()}
    assert not seeds["test"] & seeds["train"] and made["test"].frames == SCALES[scale].tested
    of_forest = {name: one.frames / one.worlds for name, one in made.items()}
    for name in study.ABLATIONS:
        assert replace(made[name], fixed=(), frames=1, worlds=3) == replace(made["train"], frames=1, worlds=3)
        assert set(made[name].fixed) == (set(FACTORS) if name == "fixed" else {name})
        assert of_forest[name] == of_forest["train"] == SCALES[scale].of_forest


@pytest.mark.parametrize("scale", SCALES)
def test_what_is_gone_on_from_is_trained_before_and_progress_counts_batches_of_all_processes(tmp_path, scale) -> None:
    whole = list(study.trainings(3, SCALES[scale]))
    names = [one.name for one in whole]
    assert len(set(names)) == len(names)
    assert all(one.start is None or names.index(one.start) < number for number, one in enumerate(whole))
    work = study._Work(whole, tmp_path)
    assert work.share() == 0.0
    total = sum(one.steps for one in whole)
    (tmp_path / f"{names[1]}.json").write_text(json.dumps({"steps": whole[1].steps}))  # of another process
    (tmp_path / f"{names[2]}.json").write_text(json.dumps({"steps": 1}))  # of an earlier study
    work._looked = -1e9
    assert work.share(100.0) == pytest.approx((whole[1].steps + 100) / total)


def test_differences_are_of_the_same_forests(tmp_path) -> None:
    """A set that is 0.1 worse in every drawing of forests is so within no interval at all, however much forests differ."""
    for data, apart in (("train", 0.0), ("light", 0.1)):
        drawn = [0.5 - apart, *(np.linspace(0.2, 0.8, 50) - apart)]
        score = {"ap50": {"log": [drawn[0], 0.0, 1.0]}, "resampled": {"log": " ".join(f"{x:.4f}" for x in drawn[1:])}}
        one = {"pictures": 100, "seed": 0, "scores": {"test": score}}
        (tmp_path / f"ablation_{data}_100_0.json").write_text(json.dumps(one))
    assert differences(tmp_path, "test", "log") == {"light": [pytest.approx(0.1, abs=1e-4)] * 3}


@pytest.mark.slow
def test_it_learns_to_tell_rectangles(rectangles, tmp_path) -> None:
    """Colours on noise are easy: after 200 batches nearly all of other pictures are found, from random weights none."""
    torch.set_num_threads(1)
    folder = tmp_path / "other"
    other = load(drawn(folder, 20, seed=9), folder / "images")
    before = score(Detector().eval(), other, resamples=2)["ap50"]["mean"][0]
    after = score(train(rectangles, steps=200), other, resamples=2)["ap50"]["mean"][0]
    assert before < 0.05 and after > 0.8
