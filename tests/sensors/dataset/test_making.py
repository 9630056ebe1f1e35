"""How the work of a data set is shared out, and what is told of it."""

from __future__ import annotations

from itertools import pairwise

import pytest

from aoro_gym.sensors.dataset import DatasetSettings, make
from aoro_gym.sensors.dataset.making import LEAST_JOB, _parted


@pytest.mark.parametrize(("count", "processes", "forests"), [(30, 1, 5), (30, 4, 5), (7, 8, 1), (500, 2, 1), (3, 2, 3)])
def test_jobs_are_all_pictures_once(count, processes, forests) -> None:
    parts = _parted(list(range(count)), processes, forests)
    assert [number for part in parts for number in part] == list(range(count))
    assert all(parts) and len(parts) >= min(-(-processes // forests), count)
    if processes == 1:
        assert len(parts) == 1
    elif count >= 2 * LEAST_JOB:
        assert max(map(len, parts)) - min(map(len, parts)) <= 1 and min(map(len, parts)) >= min(
            LEAST_JOB, count // processes
        )


def test_progress_rises_to_the_files_that_come_last(tmp_path) -> None:
    """Every picture is told of in parts; the end is left for the polygons."""
    told: list[float] = []
    settings = DatasetSettings(frames=6, worlds=3, width=48, samples=1, size=30.0, left_only=True)
    make(tmp_path, settings, progress=told.append)
    assert told[0] == 0.0 and all(a <= b for a, b in pairwise(told)) and 0.8 < told[-1] < 1.0
    assert len(set(told)) >= 2 * settings.frames + settings.worlds
    again: list[float] = []
    (tmp_path / "frames/000002.json").unlink()
    make(tmp_path, settings, progress=again.append)
    assert again[0] > 0.3 and again[-1] == pytest.approx(1.0, abs=0.2)
