"""Films of single episodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.execution.files import written_whole
from aoro_gym.reporting.page import write_animation

MOST_FRAMES, FILM_RATE = 120, 15.0
"""Of a film, and how many a second it shows at least."""
RATE_FACTOR = 28
"""Of an MP4, constant: 23, which is the codec's default, takes 1.6 times the bytes of a drive."""
ANIMATION_WIDTH = 720
"""Of a film that is no MP4 [px], at most."""


def write_film(
    result: Evaluation, run: Episodes, stem: Path, *, progress: Callable[[float], Any] = lambda share: None
) -> Path:
    """Draw the first episode: an MP4 where moviepy is installed (``pip install 'aoro-gym[video]'``), else an AVIF.

    Args:
        result: To which the episode belongs.
        run: Of one policy.
        stem: Of the file to write, without its suffix.
        progress: Called with the share that is drawn.

    Returns the file.
    """
    scene = result.scene()
    stride, rate = _frame_rate(result, run)
    frames = []
    last = np.append(np.arange(0, len(run.film) - 1, stride), len(run.film) - 1)
    for done, index in enumerate(last):
        frames.append(scene.draw(run.film[: index + 1]))
        progress((done + 1) / len(last))
    try:
        from moviepy import ImageSequenceClip
    except ImportError:
        return write_animation(stem, _thinned_frames(frames), frames_per_second=0.5 * rate)
    path = stem.with_name(f"{stem.name}.mp4")
    clip = ImageSequenceClip(frames, fps=rate)
    try:
        with written_whole(path) as temporary:
            clip.write_videofile(
                str(temporary),
                codec="libx264",
                audio=False,
                logger=None,
                pixel_format="yuv420p",
                ffmpeg_params=["-crf", str(RATE_FACTOR)],
            )
    finally:
        clip.close()
    return path


def _thinned_frames(frames: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    """Every other picture, no wider than :data:`ANIMATION_WIDTH`."""
    from PIL import Image

    height, width = frames[0].shape[:2]
    scale = min(ANIMATION_WIDTH / width, 1.0)
    size = round(scale * width), round(scale * height)
    return [np.asarray(Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS)) for frame in frames[::-2][::-1]]


def film_caption(result: Evaluation, run: Episodes) -> str:
    """What the film of ``run`` shows, and how fast."""
    stride, rate = _frame_rate(result, run)
    speed = rate * stride * result.control_step
    text = f"Its first episode, {speed:.2g} x real time; it ended so: {run.endings[0]}."
    if "cross_track_rms_m" in run.metrics:
        driven, error = run.metrics["driven_m"][0], run.metrics["cross_track_rms_m"][0]
        text += f" {driven:.1f} m driven" + (
            f", {error:.3f} m off the path (root mean square)." if math.isfinite(error) else "."
        )
    return text


def _frame_rate(result: Evaluation, run: Episodes) -> tuple[int, float]:
    """Control steps from frame to frame, and frames a second: never slower than real time."""
    stride = max(math.ceil((len(run.film) - 1) / MOST_FRAMES), 1)
    return stride, max(FILM_RATE, 1.0 / (stride * result.control_step))
