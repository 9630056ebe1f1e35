"""Gaps, outliers and places where a recording turns round on the spot, in every format, and what is none of these."""

import numpy as np
import pytest

from aoro_gym.terrains import load_path
from tests.terrains.lines import (
    collection,
    feature,
    gpx,
    gx_track,
    kml,
    line_string,
    moved,
    placemark,
    positions,
    straight,
    table,
    trk,
)

FIRST = straight(59.5, 0.5)
SECOND = straight(30.0, 0.5, start=(40.0, 80.0), heading_deg=0.0)
GAP = np.hypot(*(SECOND[0] - FIRST[-1]))


def loaded(tmp_path, points, **options):
    """Of points [m], through a CSV."""
    (tmp_path / "a.csv").write_text(table(np.asarray(points)))
    return load_path(tmp_path / "a.csv", **options)


def arc(radius: float, turn_deg: float, step: float = 0.25) -> np.ndarray:
    """(P, 2) from (0, 0), heading along x, to the left."""
    angle = np.arange(0.0, np.radians(turn_deg), step / radius)
    return radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)


# ---------------------------------------------------------------------------------------------------------------- gaps

GAPPY = {
    "segments.gpx": gpx(trk(FIRST, SECOND)),
    "within.gpx": gpx(trk(np.concatenate([FIRST, SECOND]))),
    "a.csv": table(np.concatenate([FIRST, SECOND])),
    "a.kml": kml(placemark(line_string(np.concatenate([FIRST, SECOND])))),
    "parts.kml": kml(placemark(f"<MultiGeometry>{line_string(FIRST)}{line_string(SECOND)}</MultiGeometry>")),
    "track.kml": kml(placemark(f"<gx:MultiTrack>{gx_track(FIRST)}{gx_track(SECOND)}</gx:MultiTrack>")),
    "a.geojson": collection(feature("MultiLineString", [positions(FIRST), positions(SECOND)])),
}


@pytest.mark.parametrize("name", GAPPY)
def test_a_gap_is_not_bridged_unasked(tmp_path, name):
    (tmp_path / name).write_text(GAPPY[name])
    path, report = load_path(tmp_path / name)
    assert path.length == pytest.approx(59.5, rel=1e-3)  # the longer part, of which nothing was made up
    (warning,) = report.warnings
    wide = float(warning.partition(" m ")[0].rpartition(" ")[2])
    assert wide == pytest.approx(GAP, abs=0.06)  # a decimal, and 0.01 % of `degrees`
    assert "after point 120" in warning
    assert "--join-gaps" in warning
    if len(name) > 6 and "within" not in name and "track" not in name:
        assert "segment 2 begins" in warning or name == "a.geojson"
    second = load_path(tmp_path / name, track="2")
    assert second.path.length == pytest.approx(30.0, rel=1e-3)
    assert not second.report.warnings
    joined = load_path(tmp_path / name, join_gaps=True, smoothing=0.0)
    assert joined.path.length == pytest.approx(59.5 + GAP + 30.0, rel=2e-3)
    assert "bridged straight" in joined.report.warnings[0]


def test_parts_of_one_track_of_several(tmp_path):
    (tmp_path / "a.gpx").write_text(gpx(trk(FIRST, name="day.1"), trk(FIRST, SECOND, name="day")))
    for wanted in ("day.2", "2.2"):
        assert load_path(tmp_path / "a.gpx", track=wanted).path.length == pytest.approx(30.0, rel=1e-3)
    exact = load_path(tmp_path / "a.gpx", track="day.1")  # the track of that name, not a part of the other
    assert exact.report.kind == "GPX track 'day.1'"
    assert "track=2.N" in load_path(tmp_path / "a.gpx", track=2).report.warnings[0]
    with pytest.raises(ValueError, match="part 3 is asked for, but it has 2 parts: 1 "):
        load_path(tmp_path / "a.gpx", track="day.3")
    (tmp_path / "b.gpx").write_text(gpx(trk(FIRST, SECOND, name="day"), trk(FIRST, FIRST[::-1]), trk(FIRST)))
    with pytest.raises(ValueError) as caught:
        load_path(tmp_path / "b.gpx")
    said = str(caught.value)
    assert "1 GPX track 'day' (181 points, 134.4 m, 1 gap up to 44.9 m)" in said
    assert "2 GPX track (240 points, 119.0 m, 1 turn on the spot), 3 GPX track (120 points, 59.5 m);" in said


@pytest.mark.parametrize("step", [12.0, 30.0, 80.0])
def test_waypoints_far_apart_have_no_gap(tmp_path, step):
    points = (
        np.array([[0, 0], [1, 0], [2, 0.3], [3, 0.6], [4, 0.6], [5, 0.3], [6, 0], [7, 0], [8.2, 0], [9, 0.1]]) * step
    )
    path, report = loaded(tmp_path, points)
    assert not [text for text in report.warnings if "gap" in text]
    assert np.abs(path.project(points)[1]).max() < 0.05
    # four of which one lies far away are no recording with a usual step
    few, report = loaded(tmp_path, [[0, 0], [20, 0], [40, 0], [240, 10]])
    assert few.length > 239.0
    assert not report.warnings


def test_drawn_lines_with_few_points_on_their_straights_have_no_gap(tmp_path):
    bend = arc(10.0, 80.0, step=2.0)
    drawn = np.concatenate([[[-80.0, 0.0], [-40.0, 0.0]], bend, [bend[-1] + [6.0, 60.0], bend[-1] + [12.0, 120.0]]])
    assert loaded(tmp_path, drawn).path.length > 200.0


def test_a_slower_stretch_and_small_losses_are_no_gap(tmp_path):
    slow, fast = straight(20.0, 0.2), straight(60.0, 2.0, start=(0.0, 20.2))
    lost = np.delete(np.concatenate([slow, fast]), [110, 111], axis=0)  # 6 m at 2 m/s
    path, report = loaded(tmp_path, lost)
    assert path.length == pytest.approx(80.2, abs=0.1)
    assert not report.warnings
    gpx_ = gpx(trk(FIRST[:60], FIRST[62:]))
    (tmp_path / "pause.gpx").write_text(gpx_)
    path, report = load_path(tmp_path / "pause.gpx")
    assert path.length == pytest.approx(59.5, rel=1e-3)
    assert "2 segments joined, at most 1.5 m apart" in str(report)
    assert not report.warnings


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("far", [12.0, 4000.0, 1e6, 1e11])
def test_strays_are_left_out(tmp_path, count, far):
    points = FIRST.copy()
    points[40 : 40 + count] += [far, 0.3 * far]
    path, report = loaded(tmp_path, points)
    assert path.length == pytest.approx(59.5, rel=1e-6)
    (change,) = [change for change in report.changes if change.what == "jumps"]
    assert change.count == count
    assert "point 41 (line 42)" in change.text


def test_one_coordinate_far_away_takes_no_memory(tmp_path):
    for points in (np.vstack([FIRST, [[1e6, 0.0]]]), np.vstack([[[1e6, 0.0]], FIRST])):
        path, report = loaded(tmp_path, points)
        assert path.length == pytest.approx(59.5, rel=1e-6)
        assert "a gap of 1,0" in report.warnings[0]
    with pytest.raises(ValueError, match=r"its coordinates reach 1000000 m, which are no local ones"):
        loaded(tmp_path, [[0, 0], [10, 0], [20, 0], [1e6, 0]])
    (tmp_path / "a.gpx").write_text(gpx(trk(np.array([[0, 0], [0, 20], [0, 40], [0, 1e6]]))))
    with pytest.raises(
        ValueError, match=r"point 4 \(line 6\) lies 1,00.* km from the local origin, but a path may reach 5000 m"
    ):
        load_path(tmp_path / "a.gpx")
    with pytest.raises(ValueError, match="has more than 400,000 points; cut it, or give a spacing of at least"):
        loaded(tmp_path, [[0, 0], [500, 0], [1000, 0]], spacing=0.001)


# --------------------------------------------------------------------------------------------------- turning on the spot


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.05])
@pytest.mark.parametrize("step", [0.2, 0.37, 1.0, 5.0])
def test_out_and_back_is_said_and_parted(tmp_path, noise, step):
    out = straight(60.0, step)
    both = np.concatenate([out, out[-2::-1] if noise == 0.0 else out[::-1]])
    both = both + np.random.default_rng(1).normal(0.0, noise, both.shape)
    with pytest.raises(
        ValueError, match=r"the recording turns round on the spot at (59|6[0-3])\.\d m \(point \d+ \(line"
    ) as caught:
        loaded(tmp_path, both)
    assert "track=N (--track) of its 2 parts" in str(caught.value)
    for part, north in (("1", 1.0), ("2", -1.0), (2, -1.0), ("1.2", -1.0)):
        path, report = loaded(tmp_path, both, track=part)
        assert path.length == pytest.approx(out[-1, 1], abs=1.5)
        assert np.sign(path.points[-1, 1] - path.points[0, 1]) == north
        assert any(change.what == "part" for change in report.changes)
    with pytest.raises(ValueError, match="part 3 is asked for, but it has 2 parts"):
        loaded(tmp_path, both, track=3)


@pytest.mark.parametrize("beside", [0.1, 0.3, 0.6, 0.8])
def test_a_way_back_close_beside_the_way_out_is_a_turn_on_the_spot(tmp_path, beside):
    both = np.concatenate([straight(60.0, 0.5), straight(60.0, 0.5, start=(beside, 60.0), heading_deg=-90.0)])
    with pytest.raises(ValueError, match=r"turns round on the spot at (59|60|61)\.\d m .* its 2 parts"):
        loaded(tmp_path, both)
    assert loaded(tmp_path, both, track=2).path.length == pytest.approx(60.0, abs=1.5)


@pytest.mark.parametrize("seed", range(4))
def test_out_and_back_is_seen_through_noise(tmp_path, seed):
    both = np.concatenate([straight(60.0, 0.4), straight(60.0, 0.4)[::-1]])
    both = both + np.random.default_rng(seed).normal(0.0, 0.3, both.shape)
    with pytest.raises(ValueError, match=r"turns round on the spot .* its 2 parts") as caught:
        loaded(tmp_path, both)
    turn = int(str(caught.value).partition("(point ")[2].partition(" ")[0])
    assert turn == pytest.approx(151, abs=12)


def test_three_point_turn_within_a_recording(tmp_path):
    ahead = np.concatenate([straight(40.0, 0.25, heading_deg=0.0), moved(arc(5.0, 60.0)[1:], 40.0, 0.0)])
    heading = np.radians(60.0)
    # backwards along the other hand's arc, then ahead again
    turned = arc(5.0, 60.0) @ np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    back = ahead[-1] - turned * [1.0, 1.0]
    on = straight(30.0, 0.25, start=tuple(back[-1]), heading_deg=120.0)[1:]
    whole = np.concatenate([ahead, back[1:], on])
    with pytest.raises(ValueError, match=r"turns round on the spot at 45\.\d m .* and 1 more times, .* its 3 parts: 1"):
        loaded(tmp_path, whole)
    assert loaded(tmp_path, whole, track=1).path.length == pytest.approx(45.2, abs=0.5)
    assert loaded(tmp_path, whole, track=2).path.length == pytest.approx(5.2, abs=0.5)
    assert loaded(tmp_path, whole, track=3).path.length == pytest.approx(30.0, abs=0.5)


def test_what_turns_without_standing_is_whole(tmp_path):
    u_turn = np.concatenate([straight(20.0, 0.3, heading_deg=0.0), moved(arc(2.0, 180.0), 20.0, 0.0)])
    u_turn = np.concatenate([u_turn, straight(20.0, 0.3, start=(20.0, 4.0), heading_deg=180.0)])
    assert loaded(tmp_path, u_turn).path.length > 43.0
    corner = np.concatenate([straight(20.0, 0.5), straight(20.0, 0.5, start=(0.0, 20.0), heading_deg=-30.0)[1:]])
    assert loaded(tmp_path, corner).path.length > 38.0
    eight = np.linspace(0.0, 2.0 * np.pi, 300)
    assert loaded(tmp_path, np.stack([20 * np.sin(eight), 10 * np.sin(2 * eight)], axis=1)).path.length > 100.0


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_drift_at_a_standstill_are_no_turn(tmp_path, seed):
    rng = np.random.default_rng(seed)
    driven = np.concatenate([straight(40.0, 0.3), straight(40.0, 0.3, start=(0.0, 40.0), heading_deg=20.0)[1:]])
    noisy = driven + rng.normal(0.0, 0.12, driven.shape)
    assert loaded(tmp_path, noisy).path.length == pytest.approx(80.0, rel=0.06)
    drift = np.cumsum(rng.normal(0.0, 0.04, (300, 2)), axis=0)
    drift = driven[60] + 0.25 * drift / np.abs(drift).max()
    waiting = np.concatenate([driven[:60], drift, driven[60:]])
    assert loaded(tmp_path, waiting).path.length == pytest.approx(80.0, rel=0.06)
