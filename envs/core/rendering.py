"""Pictures of a task without a display: their renderer, what they are drawn on, and the page or window that shows them."""

from __future__ import annotations

import sys
import time
import webbrowser
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine import Machine
from aoro_gym.reporting.display import has_display
from aoro_gym.reporting.style import GRID, INK, SOFT
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from aoro_gym.envs.core.task import Task
    from aoro_gym.twin import Twin
    from aoro_gym.view.page import TwinPage

RENDER_MODES = ("rgb_array", "human")
PAPER = "#ffffff"


class Scene(Protocol):
    """Draws one sub-environment."""

    size: tuple[int, int]
    """Width and height of its pictures [px]."""

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture (height, width, 3) of ``history`` (frames, channels), oldest first; rows before the start are NaN."""
        ...


class Renderer:
    """Keeps the traces of all sub-environments, draws them, and shows the first one: in the browser, or where viser is not
    installed in a window."""

    def __init__(self, task: Task, num_envs: int, machine: Machine):
        self._task = task
        self._scene: Scene = task.scene(machine)
        self._control_step = task.control_step
        frames = round(task.render_span / task.control_step) + 1
        self._history = np.full((frames, len(task.render_channels), num_envs), np.nan, dtype=np.float32)  # a ring
        self._newest = frames - 1
        self._window: Window | None = None
        self._page: TwinPage | None = None

    def traces(self) -> tuple[NDArray[np.float32], int]:
        """What is kept of all sub-environments, for :meth:`take_up`."""
        return self._history, self._newest

    def take_up(self, traces: tuple[NDArray[np.float32], int]) -> None:
        """Go on from the traces of another renderer."""
        self._history, self._newest = traces

    def restart(self, where: NDArray[np.intp], traces: NDArray[np.float32]) -> None:
        """Forget the sub-environments ``where``; ``traces`` (channels, N) are their first."""
        self._history[:, :, where] = np.nan
        self._history[self._newest][:, where] = traces[:, where]

    def record(self, traces: NDArray[np.float32]) -> None:
        """Append the traces (channels, N) of a control step."""
        self._newest = (self._newest + 1) % len(self._history)
        self._history[self._newest] = traces

    def frame(self, index: int) -> NDArray[np.uint8]:
        """Picture (height, width, 3) of a sub-environment."""
        return self._scene.draw(np.roll(self._history[:, :, index], -1 - self._newest, axis=0))

    def show(self, twin: Twin) -> None:
        """Show the first sub-environment, whose twin is the first of ``twin``, in real time."""
        if self._page is None and self._window is None:
            self._page = opened_page(twin)
        if self._page is not None:
            self._page.surround(*surroundings(self._task, twin))
            self._page.show(self._control_step)
            return
        if self._window is None:
            self._window = Window(self._control_step, self._scene.size)
        if self._window.open:
            self._window.show(self.frame(0))

    def close(self) -> None:
        """Close the page or the window."""
        if self._page is not None:
            self._page.close()
        if self._window is not None:
            self._window.close()


def opened_page(twin: Twin) -> TwinPage | None:
    """A page in the browser, whose address is told; None without viser."""
    from aoro_gym.view.extras import is_installed

    if not is_installed():
        return None
    from aoro_gym.view.page import page_of

    page = page_of(twin)
    print(f"aoro-gym: the environment is at {page.address}", file=sys.stderr, flush=True)
    if has_display():
        webbrowser.open(page.address)
    return page


def surroundings(task: Task, twin: Twin) -> tuple[Plane | Terrain | World, Path | None]:
    """Ground and path of the first sub-environment, as the task's ``surroundings`` says, or the twins' ground."""
    told = getattr(task, "surroundings", None)
    if told is not None:
        return told()
    ground = twin.terrain
    return (ground if isinstance(ground, Plane | Terrain | World) else ground[0]), None


class Window:
    """A window of matplotlib's interactive backend. Without a display it says so once and draws nothing."""

    def __init__(self, control_step: float, size: tuple[int, int]):
        self._control_step = control_step
        self._next = 0.0
        self._image: Any = None
        self.open = False
        import matplotlib
        from matplotlib import pyplot

        self._pyplot = pyplot
        if has_display():
            try:
                self._figure = pyplot.figure("aoro-gym", figsize=(size[0] / 100, size[1] / 100), dpi=100)
                self.open = matplotlib.get_backend().lower() in {name.lower() for name in _interactive_backends()}
            except ImportError:
                pass
        if not self.open:
            print(
                'aoro-gym: render_mode="human" needs the part view (pip install -c constraints.txt -e ".[view]"), or a '
                'display and a windowing backend of matplotlib (PyQt6); nothing is drawn. render_mode="rgb_array" needs '
                "neither.",
                file=sys.stderr,
                flush=True,
            )

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show ``frame`` and wait for its time."""
        if not self._pyplot.fignum_exists(self._figure.number):  # closed by its user
            self.open = False
            return
        if self._image is None:
            axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axes.set_axis_off()
            self._image = axes.imshow(frame)
            self._figure.show()
        self._image.set_data(frame)
        self._figure.canvas.draw_idle()
        self._figure.canvas.flush_events()
        now = time.perf_counter()
        self._next = max(self._next + self._control_step, now)
        time.sleep(max(self._next - now, 0.0))

    def close(self) -> None:
        """Close it."""
        if self.open:
            self._pyplot.close(self._figure)
            self.open = False


def _interactive_backends() -> Sequence[str]:
    from matplotlib.backends.registry import BackendFilter, backend_registry

    return backend_registry.list_builtin(BackendFilter.INTERACTIVE)


# ---- pictures --------------------------------------------------------------------------------------------------------


class Canvas:
    """A picture whose standing parts are drawn once: a frame draws only the artists that :meth:`moving` was told of."""

    def __init__(self, size: tuple[int, int]) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.size = size
        self.figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, facecolor=PAPER)
        self._canvas = FigureCanvasAgg(self.figure)
        self._moving: list[Artist] = []
        self._background: Any = None

    def axes(self, left: float, bottom: float, width: float, height: float) -> Axes:
        """Axes in pixels from the lower left corner."""
        across, up = self.size
        return self.figure.add_axes((left / across, bottom / up, width / across, height / up))

    def moving(self, artist: Any) -> Any:
        """Draw ``artist`` anew in every frame, after those that came before it; returns it."""
        artist.set_animated(True)
        self._moving.append(artist)
        return artist

    def forget(self) -> None:
        """Draw the standing parts anew: they have changed."""
        self._background = None

    def picture(self) -> NDArray[np.uint8]:
        """The frame as it stands, (height, width, 3)."""
        if self._background is None:
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self.figure.bbox)
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            if artist.get_visible():
                artist.draw(self._canvas.get_renderer())
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3].copy()


class Traces:
    """A strip of lines over the last seconds, the present at its right end.

    Args:
        canvas: Where it stands.
        axes: Its own.
        title: Over it.
        limit: Largest value, or lowest and largest.
        ticks: On the vertical axis.
        span: How far back it reaches [s].
        every: Distance of the ticks of time [s].
        gap: Distance of the lines' names, as a share of the width.
    """

    def __init__(
        self,
        canvas: Canvas,
        axes: Axes,
        title: str,
        limit: float | tuple[float, float],
        ticks: Sequence[float],
        *,
        span: float,
        every: float = 1.0,
        gap: float = 0.09,
    ):
        self._canvas, self._axes, self._gap = canvas, axes, gap
        low, high = limit if isinstance(limit, tuple) else (-limit, limit)
        axes.set_xlim(-span, 0.0)
        axes.set_ylim(low, high)
        times = np.arange(-span, 0.5 * every, every)
        axes.set_xticks(times, labels=[f"{t:.0f} s" if t else "now" for t in times])
        axes.set_yticks(list(ticks))
        axes.tick_params(length=0, labelsize=8, labelcolor=SOFT)
        axes.grid(color=GRID, linewidth=0.8)
        axes.axhline(0.0, color=SOFT, linewidth=0.8)
        for spine in axes.spines.values():
            spine.set_visible(False)
        axes.set_title(title, loc="left", fontsize=9, color=INK, pad=4)
        self._labels = 0

    def line(self, label: str, colour: str, **style: Any) -> Any:
        """A line, named in the legend."""
        (line,) = self._axes.plot([], [], color=colour, **{"linewidth": 1.8, "solid_joinstyle": "round", **style})
        self._axes.text(
            1.0 - self._gap * self._labels, 1.03, label, color=colour, fontsize=9, ha="right", va="bottom",
            transform=self._axes.transAxes,
        )  # fmt: skip
        self._labels += 1
        return self._canvas.moving(line)
