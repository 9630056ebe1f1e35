"""Files of terrains and paths that a command is given."""

import pytest

from tests.cli.calling import call


@pytest.mark.parametrize("command", ["evaluate", "train"])
def test_a_track_of_several_is_asked_for(tmp_path, command):
    one, other = (f"<trk><name>{name}</name><trkseg>{{}}</trkseg></trk>" for name in ("[/x] route", "yard"))
    points = "".join(f'<trkpt lat="{60 + 1e-5 * i:.6f}" lon="24"/>' for i in range(3))
    (tmp_path / "two.gpx").write_text(f"<gpx>{one.format(points)}{other.format(points)}</gpx>")
    asked = [command, "--env", "AORO/PathTracking-v0", "--path", tmp_path / "two.gpx", "--out", tmp_path / "out"]
    shown = call(*asked)
    assert shown.exit_code == 2
    said = " ".join(shown.stderr.split())
    assert "it holds 2 tracks: 1 GPX track '[/x] route' (3 points, 2.2 m), 2 GPX track 'yard'" in said
    assert "(--track)" in said
    shown = call(*asked, "--track", "yards")
    assert shown.exit_code == 2
    assert "no track is called 'yards'; it holds 2 tracks" in " ".join(shown.stderr.split())
    shown = call(*asked, "--track", "[/x] route")
    assert shown.exit_code == 2  # too short to drive
    assert "path 'two' is 2.23 m long" in " ".join(shown.stderr.split())
    without = [command, "--env", "AORO/PathTracking-v0", "--out", tmp_path / "out"]
    assert "--join-gaps is for a path; give its file with --path" in call(*without, "--join-gaps").stderr
    unknown = call(*asked, "--track", "yard", "--path-crs", "EPSG:nine")
    assert "error: --path-crs is 'EPSG:nine', which is unknown" in unknown.stderr
