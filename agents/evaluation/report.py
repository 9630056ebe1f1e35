"""An evaluation as a table, plots, films and one self-contained page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.evaluate import BOUNDED, OVER, RATES, Episodes, Evaluation, Interval
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.files import write_json, written_whole
from aoro_gym.reporting.page import Passage, passage_section, write_gif, write_page
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, PLOT_STYLE, PURPLE, RED, SOFT
from aoro_gym.reporting.terminal import Comparison
from aoro_gym.terrains import Plane
from aoro_gym.terrains.figures import draw_terrain, place_legend
from aoro_gym.terrains.generate.forest import Obstacle

COLOURS = (BLUE, AMBER, GREEN, PURPLE, RED, "#6b4a2b", INK, SOFT)
"""Of the policies, in their order."""
UNITS = {"m_per_s": "m/s", "kJ": "kJ", "deg": "°", "m": "m", "s": "s", "rate": "%", "share": "%"}
"""By the last words of a figure's name."""
MOST_FRAMES, FILM_RATE = 120, 15.0
"""Of a film, and how many a second it shows at least."""
GIF_WIDTH = 720
"""Of a film that is no MP4 [px], at most."""
MOST_PLANS = 3
"""Courses that are drawn, those with most episodes."""


def write_report(
    result: Evaluation,
    folder: Path,
    *,
    films: bool = True,
    lead: str | None = None,
    made_by: Mapping[str, Any] | None = None,
    progress: Callable[[str, float], Any] | None = None,
) -> list[Path]:
    """Write ``evaluation.json``, plots (PNG), films and ``index.html``.

    Args:
        result: What to report on.
        folder: Made if it is not there.
        films: Whether to draw each policy's first episode, which takes most of the time.
        lead: What the page says of the machine; its name by default.
        made_by: Put into the JSON under this name.
        progress: Called with what is drawn and the share of it that is done.

    Returns what was written.
    """
    tell = progress or (lambda what, share: None)
    tell("plots", 0.0)
    summary, figures, errors, page = (
        folder / name for name in ("evaluation.json", "figures.png", "errors.png", "index.html")
    )
    content = result.to_json() | ({} if made_by is None else {"made_by": dict(made_by)})
    write_json(summary, content)
    write_figures(result, figures)
    write_errors(result, errors)
    plans = write_plans(result, folder)
    passages = [
        Passage("Figures", _explained(result), [figures], table=figure_rows(result)),
        Passage("Errors", f"Of all episodes: {result.trial.error} against the {result.trial.along}.", [errors]),
    ]
    if len(result.runs) > 1:
        text = (
            f"Each policy less {next(iter(result.runs))}, episode by episode, over those in which both have the figure and "
            "neither is a lower bound: what the episodes share cancels, so these "
            "intervals tell policies apart whose own overlap. Those that leave out 0 are beyond chance."
        )
        passages.insert(1, Passage("Differences", text, table=difference_rows(result)))
    if plans:
        text = "Where each policy drove; the paths are dashed, a cross marks an episode that ended badly."
        passages.append(Passage("From above", text, plans))
    drawn = []
    for policy, run in result.runs.items() if films else ():
        stem, before = folder / _file_name(policy), len(drawn) / len(result.runs)

        def told(share: float, name: str = policy, before: float = before) -> None:
            tell(f"film: {name}", before + share / len(result.runs))

        drawn.append(write_film(result, run, stem, progress=told))
        passages.append(Passage(policy, film_caption(result, run), [drawn[-1]]))
    about = f"{result.env}, {counted(result)} a policy from seed {result.seed}."
    lead = f"{about} {lead or f'Machine {result.machine.name}.'}"
    write_page(page, "AORO: evaluation", lead, map(passage_section, passages), interactive=False)
    return [summary, figures, errors, *plans, *drawn, page]


# ---- table -----------------------------------------------------------------------------------------------------------


def describe(name: str) -> tuple[str, str]:
    """Words and unit of a figure: ``cross_track_rms_m`` is ('cross track rms', 'm')."""
    for end, unit in UNITS.items():
        if name.endswith(f"_{end}"):
            words = name if unit == "%" else name.removesuffix(f"_{end}")
            return words.replace("_", " "), unit
    return name.replace("_", " "), ""


def shown_as(unit: str) -> float:
    """Factor from a figure to what is shown of it."""
    return 100.0 if unit == "%" else 1.0


def named(name: str) -> tuple[str, str]:
    """The same, with what the figure is over where that is not everything: ('cross track rms, of successes', 'm')."""
    words, unit = describe(name)
    return (f"{words}, {SHORT[OVER[name]]}", unit) if name in OVER else (words, unit)


SHORT = {"successful episodes": "of successes", "targets that were reached": "of targets reached"}
"""What figures are over, in a table."""
MARKS = (
    "≥: a lower bound, as not all targets were settled or paths driven. (n): over n episodes, as the others have none."
)
"""What :func:`shown` marks."""


def shown(value: Interval, unit: str, *, finer: int = 0, total: int | None = None) -> str:
    """``mean [low, high]`` to three digits of the mean and ``finer`` ones; shares in per cent. After ``≥`` where it is a
    lower bound, before ``(n)`` where it is over n episodes of the ``total`` only."""
    if not math.isfinite(value.mean):
        return "-"
    scale = shown_as(unit)
    size = abs(scale * value.mean)
    digits = 0 if unit == "%" or size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 1.0 else 3
    mean, low, high = (f"{scale * number:.{digits + finer}f}" for number in value[:3])
    text = mean if not math.isfinite(value.low95) else f"{mean} [{low}, {high}]"
    if value.bounds:
        text = f"≥ {text}"
    return text if value.episodes is None or total in (None, value.episodes) else f"{text} ({value.episodes})"


def figure_rows(result: Evaluation) -> list[list[str]]:
    """The figures and endings, a column for each policy, the best first; the first row is the head."""
    summary, middle, endings, policies = result.summary, result.interquartile, result.endings, result.ranking
    total = result.episodes * result.repeats
    rows = [["mean [95 % interval]", "unit", *policies]]
    for name in next(iter(summary.values())):
        words, unit = named(name)
        rows.append([words, unit, *(shown(summary[policy][name], unit, total=total) for policy in policies)])
    for name in result.trial.decisive:
        words, unit = named(name)
        values = [shown(middle[policy][name], unit, total=total) for policy in policies]
        rows.append([f"{words}, middle half", unit, *values])
    for name in result.trial.decisive if result.stratified else ():
        words, unit = named(name)
        values = [shown(result.stratified[policy][name], unit, finer=1, total=total) for policy in policies]
        rows.append([f"{words}, middle half, over repeats", unit, *values])
    if len(next(iter(endings.values()))) > 1 or result.courses:
        for ending in next(iter(endings.values())):
            rows.append([f"ended: {ending}", "%", *(shown(endings[policy][ending], "%") for policy in policies)])
    return rows


def difference_rows(result: Evaluation) -> list[list[str]]:
    """Every figure of the other policies less that of the first one, a column for each; the first row is the head."""
    differences = result.differences
    total = result.episodes * result.repeats
    rows = [["mean difference [95 % interval]", "unit", *differences]]
    for name in next(iter(result.runs.values())).figures:
        words, unit = named(name)
        rows.append([words, unit, *(shown(found[name], unit, total=total) for found in differences.values())])
    return rows


def table(result: Evaluation) -> Comparison:
    """The same for a terminal."""
    head, *rows = figure_rows(result)
    return Comparison(f"{result.env}: {counted(result)} a policy, the best first", head, rows, lead=2, note=MARKS)


def _explained(result: Evaluation) -> str:
    text = (
        "Every policy drove the same episodes: same seeds, courses, starts and noise. Means over the episodes with 95 % "
        "intervals: bootstrap over the episodes, of rates exact (Clopper and Pearson). Policies stand by their success, "
        f"then by {describe(result.trial.decisive[0])[0]}. {MARKS}"
    )
    if result.repeats > 1:
        text += (
            f" Each episode was driven {result.repeats} times with other noise; intervals over repeats are of these "
            "episodes, by a stratified bootstrap."
        )
    if result.courses:
        text += " Errors are true ones of the front axle's middle."
        names = [course.name for course in result.courses]
        text += f" Driven on: {', '.join(names)}."
    return text


# ---- plots -----------------------------------------------------------------------------------------------------------


def write_figures(result: Evaluation, path: Path) -> None:
    """A panel for each figure: its mean and interval for every policy, single episodes behind."""
    import matplotlib
    from matplotlib.figure import Figure

    summary, policies = result.summary, result.ranking
    names = list(next(iter(summary.values())))
    columns = 2 if len(names) < 5 else 3
    rows = math.ceil(len(names) / columns)
    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(12.0, 0.5 + rows * (0.75 + 0.3 * len(policies))), dpi=130, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        spread = np.random.default_rng(0).uniform(-0.25, 0.25, result.episodes * result.repeats)
        for index, name in enumerate(names):
            axis = axes[index]
            words, unit = named(name)
            words = (
                f"{words}, at least"
                if name in BOUNDED and any(found[name].bounds for found in summary.values())
                else words
            )
            scale = shown_as(unit)
            for height, policy in enumerate(policies):
                value = summary[policy][name]
                colour = COLOURS[height % len(COLOURS)]
                if name not in RATES:
                    single = scale * result.runs[policy].figures[name]
                    axis.plot(single, height + spread, "o", color=colour, ms=3.5, alpha=0.25, mew=0, zorder=2)
                if math.isfinite(value.low95):
                    ends = [scale * value.low95, scale * value.high95]
                    axis.plot(ends, [height, height], color=colour, lw=3.2, solid_capstyle="butt", zorder=3)
                axis.plot([scale * value.mean], [height], "o", color=colour, ms=7.5, mec="white", mew=1.0, zorder=4)
            axis.set_title(f"{words} [{unit}]" if unit else words, loc="left", fontsize=10.5, fontweight="bold")
            first = index % columns == 0
            axis.set_yticks(range(len(policies)), labels=policies if first else [""] * len(policies))
            axis.set_ylim(len(policies) - 0.5, -0.5)
            if unit == "%" and all(0.0 <= summary[policy][name].mean <= 1.0 for policy in policies):
                axis.set_xlim(-3.0, 103.0)
            axis.locator_params(axis="x", nbins=5)
            axis.grid(True, axis="x")
            axis.tick_params(axis="y", length=0)
            axis.spines[["top", "right", "left"]].set_visible(False)
        for axis in axes[len(names) :]:
            axis.set_visible(False)
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def write_errors(result: Evaluation, path: Path) -> None:
    """Error along the episodes: median, half and nine tenths of them, a panel for each policy."""
    import matplotlib
    from matplotlib.figure import Figure

    count = len(result.runs)
    columns = min(count, 2)
    rows = math.ceil(count / columns)
    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(12.0, 0.6 + 2.9 * rows), dpi=130, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        highest = 0.0
        for index, (policy, run) in enumerate(result.runs.items()):
            axis, colour = axes[index], COLOURS[index % len(COLOURS)]
            known = np.isfinite(run.errors)
            there = known.sum(axis=0)
            errors = run.errors[:, there > 0]
            along = result.trial.interval * np.flatnonzero(there)
            bands = np.nanquantile(errors, [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
            axis.fill_between(along, bands[0], bands[4], color=colour, alpha=0.16, lw=0, label="nine tenths")
            axis.fill_between(along, bands[1], bands[3], color=colour, alpha=0.32, lw=0, label="half")
            axis.plot(along, bands[2], color=colour, lw=1.8, label="median")
            few = np.flatnonzero(there[there > 0] < len(run.endings))
            # paths end within a step or two of one another: not worth a word
            note = f"fewer episodes from {along[few[0]]:.3g} on" if few.size > 2 else ""
            axis.set_title(policy, loc="left", fontsize=10.5, fontweight="bold")
            axis.set_title(note, loc="right", fontsize=8.5, color=SOFT)
            axis.grid(True)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
            highest = max(highest, float(bands[4].max()))
            if index % columns == 0:
                axis.set_ylabel(result.trial.error)
            if index >= count - columns:
                axis.set_xlabel(result.trial.along)
                axis.tick_params(labelbottom=True)
        axes[0].set_ylim(0.0, 1.08 * highest if highest > 0.0 else 1.0)
        axes[0].set_xlim(left=0.0)
        axes[0].legend(frameon=False, fontsize=8.5, ncols=3, loc="upper right")
        for axis in axes[count:]:
            axis.set_visible(False)
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def write_plans(result: Evaluation, folder: Path) -> list[Path]:
    """Plan views of the courses that were driven most: ground, paths and where every policy drove; returns the files."""
    if not result.courses:
        return []
    episodes = next(iter(result.runs.values())).course[:, 0]
    driven, times = np.unique(episodes, return_counts=True)
    written = []
    for number in driven[np.argsort(-times, kind="stable")][:MOST_PLANS]:
        written.append(folder / f"plan_{number + 1}.png")
        _write_plan(result, int(number), written[-1])
    return written


def _write_plan(result: Evaluation, number: int, path: Path) -> None:
    import matplotlib
    from matplotlib.lines import Line2D

    course = result.courses[number]
    with matplotlib.rc_context(PLOT_STYLE):
        figure = _ground(course)
        axis = figure.axes[0]
        old = axis.get_legend()
        handles = [] if old is None else list(old.legend_handles)
        rows = next(iter(result.runs.values())).course
        used = np.unique(rows[rows[:, 0] == number, 1])
        for row in used:
            way = course.paths[row]
            around = np.concatenate([way.points, way.points[:1]]) if way.closed else way.points
            axis.plot(*around.T, color="white", lw=5.0, alpha=0.75, solid_capstyle="round", zorder=5)
            axis.plot(*around.T, color=INK, lw=1.0, ls=(0, (4, 3)), zorder=6)
        handles.append(Line2D([], [], color=INK, lw=1.0, ls=(0, (4, 3)), label="path"))
        for index, (policy, run) in enumerate(result.runs.items()):
            colour = COLOURS[index % len(COLOURS)]
            width = 1.2 + 1.3 * (len(result.runs) - 1 - index)  # good ones drive in each other's tracks: all shall show
            for i in np.flatnonzero(run.course[:, 0] == number):
                trace = run.places[i][np.isfinite(run.places[i, :, 0])]
                axis.plot(*trace.T, color=colour, lw=width, zorder=7 + index)
                if not run.figures["success_rate"][i]:
                    axis.plot(*trace[-1], "X", color=colour, ms=8, mec="white", mew=0.8, zorder=30)
            handles.append(Line2D([], [], color=colour, lw=1.8, label=policy))
        place_legend(axis, handles)
        with written_whole(path) as temporary:
            figure.savefig(temporary, dpi=110, bbox_inches="tight")


def _ground(course: Course) -> Any:
    """The course's ground without its paths."""
    from matplotlib.figure import Figure

    if isinstance(course.terrain, Plane):
        figure = Figure(figsize=(10.0, 6.0), dpi=130, layout="constrained")
        axis = figure.add_subplot()
        axis.set_aspect("equal", adjustable="datalim")
        axis.grid(True)
        axis.set_xlabel("x, east [m]")
        axis.set_ylabel("y, north [m]")
        axis.set_title(course.name, loc="left", fontsize=11, fontweight="bold")
        return figure
    trees = [Obstacle("tree", *(float(value) for value in tree)) for tree in course.trees]
    return draw_terrain(course.terrain, obstacles=trees, title=course.name)


# ---- films -----------------------------------------------------------------------------------------------------------


def write_film(
    result: Evaluation, run: Episodes, stem: Path, *, progress: Callable[[float], Any] | None = None
) -> Path:
    """Draw the first episode: an MP4 where moviepy is installed (``pip install 'aoro-gym[video]'``), else a GIF.

    Args:
        result: To which the episode belongs.
        run: Of one policy.
        stem: Of the file to write, without its suffix.
        progress: Called with the share that is drawn.

    Returns the file.
    """
    scene = result.scene()
    stride, rate = _pace(result, run)
    frames = []
    last = np.append(np.arange(0, len(run.film) - 1, stride), len(run.film) - 1)
    for done, index in enumerate(last):
        frames.append(scene.draw(run.film[: index + 1]))
        if progress is not None:
            progress((done + 1) / len(last))
    try:
        from moviepy import ImageSequenceClip
    except ImportError:
        path = stem.with_name(f"{stem.name}.gif")
        write_gif(path, _lighter(frames), frames_per_second=0.5 * rate)
        return path
    path = stem.with_name(f"{stem.name}.mp4")
    clip = ImageSequenceClip(frames, fps=rate)
    try:
        with written_whole(path) as temporary:
            clip.write_videofile(str(temporary), codec="libx264", audio=False, logger=None, pixel_format="yuv420p")
    finally:
        clip.close()
    return path


def _lighter(frames: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    """Every other picture, no wider than a GIF should be, which hardly compresses."""
    from PIL import Image

    height, width = frames[0].shape[:2]
    scale = min(GIF_WIDTH / width, 1.0)
    size = round(scale * width), round(scale * height)
    return [np.asarray(Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS)) for frame in frames[::-2][::-1]]


def film_caption(result: Evaluation, run: Episodes) -> str:
    """What the film of ``run`` shows, and how fast."""
    stride, rate = _pace(result, run)
    speed = rate * stride * result.control_step
    text = f"Its first episode, {speed:.2g} x real time; it ended so: {run.endings[0]}."
    if "cross_track_rms_m" in run.figures:
        driven, error = run.figures["driven_m"][0], run.figures["cross_track_rms_m"][0]
        text += f" {driven:.1f} m driven" + (
            f", {error:.3f} m off the path (root mean square)." if math.isfinite(error) else "."
        )
    return text


def _pace(result: Evaluation, run: Episodes) -> tuple[int, float]:
    """Control steps from frame to frame, and frames a second: never slower than real time."""
    stride = max(math.ceil((len(run.film) - 1) / MOST_FRAMES), 1)
    return stride, max(FILM_RATE, 1.0 / (stride * result.control_step))


def _file_name(policy: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in policy)


def counted(result: Evaluation) -> str:
    """How much was driven."""
    text = f"{result.episodes} episode{'' if result.episodes == 1 else 's'}"
    return text if result.repeats == 1 else f"{text}, {result.repeats} times each"
