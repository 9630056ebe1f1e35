"""What a data set's pictures cost is told, by steps and by launches."""

from __future__ import annotations

from argparse import Namespace

from studies.dataset_speed import STEPS, measure


def test_pictures_that_are_taken_together_share_launches_and_copies() -> None:
    """Twelve launches and four copies home for all of them; for the parts of the picture alone there were 30 and 130."""
    asked = Namespace(frames=9, worlds=3, steps=3, size=45.0, width=32, device="cpu", processes=1)
    found = measure(asked)
    assert set(found["steps"]) == set(STEPS) and all(each["ms"] > 0.0 for each in found["steps"].values())
    counts = found["a_picture"]
    assert counts["pictures"] == 3
    assert counts["launches"] <= 12 / 3 and counts["copies_home"] <= 4 / 3
    assert found["pictures_per_s"] > 0.0
