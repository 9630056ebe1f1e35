"""Reports as one self-contained HTML page that works without a network.

Pages are made of blocks, the macros of ``templates/blocks.html``; whatever is not HTML already is escaped there.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from aoro_gym.execution.files import write_text, written_whole
from aoro_gym.reporting.style import GRID, INK, SOFT
from aoro_gym.version import VERSION

if TYPE_CHECKING:
    from jinja2 import Environment

MEDIA = {".png": "image/png", ".webp": "image/webp", ".avif": "image/avif", ".gif": "image/gif", ".mp4": "video/mp4"}
"""Media types of pictures, by suffix; Python's own table lacks WebP and AVIF up to 3.12."""
PICTURE_QUALITY, FILM_QUALITY = 90, 65
"""Of pictures and films with loss, of 100."""
AVIF_SPEED = 8
"""Of writing a film, of 10: 4 s for 75 pictures of 720 by 720 (measured); 6 takes three times as long."""

Section = tuple[str, Markup]
"""Title and HTML of a section of a page."""


@dataclass(frozen=True)
class Passage:
    """A part of a page that is no recording: text, a table and pictures."""

    title: str
    text: str
    pictures: Sequence[Path] = ()
    """PNG, AVIF, WebP, GIF or MP4 files; the page holds copies."""
    more: str = ""
    """Address of a page that says more."""
    table: Sequence[Sequence[str]] = ()
    """Rows of cells; the first one is the head."""

    @property
    def section(self) -> Section:
        """The passage as :func:`write_page` takes it."""
        table = [block("table", head=self.table[0], rows=self.table[1:])] if self.table else []
        pictures = [block("card", contents=[picture(file)]) for file in self.pictures]
        return self.title, joined([block("paragraph", text=self.text, link=self.more), *table, *pictures])


@cache
def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("aoro_gym.reporting")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def block(name: str, **values: Any) -> Markup:
    """HTML of the macro ``name`` of ``templates/blocks.html``, with ``values`` by its parameters."""
    return getattr(_templates().get_template("blocks.html").module, name)(**values)


def joined(blocks: Iterable[Markup]) -> Markup:
    """Blocks one below the other."""
    return Markup("").join(blocks)


def write_page(
    path: Path,
    title: str,
    lead: str,
    sections: Iterable[Section],
    *,
    top: Markup | None = None,
    footer: str = "",
    interactive: bool = True,
) -> None:
    """Write one page; it needs no other file and no network.

    Args:
        path: File to write.
        title: Of the page.
        lead: A sentence below it.
        sections: In their order; those without a body are left out.
        top: HTML that stands above them.
        footer: A sentence at the end.
        interactive: Whether it holds plots of plotly, whose code takes two megabytes, compressed.
    """
    page = _templates().get_template("page.html")
    plotly = _plotly_code() if interactive else ""
    shown = [(heading, body) for heading, body in sections if body]
    values = {"title": title, "lead": lead, "top": top or "", "footer": footer}
    write_text(path, page.render(sections=shown, plotly=plotly, version=VERSION, **values))


@cache
def _plotly_code() -> str:
    """Code of plotly, for :func:`packed` scripts of a page."""
    from plotly.offline import get_plotlyjs

    return packed(get_plotlyjs())


def packed(text: str) -> str:
    """``text`` as gzip in base64, which a page unpacks by DecompressionStream; the same text gives the same bytes."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), compresslevel=9, mtime=0)).decode("ascii")


def picture(file: Path) -> Markup:
    """An image or a film that stands in the page itself; a PNG, which is a drawing, as a WebP where that is smaller."""
    content, kind = file.read_bytes(), MEDIA[file.suffix]
    if file.suffix == ".mp4":
        return block("film", source=data_address(content, kind))
    if file.suffix == ".png":
        content, kind = min((content, kind), (_as_webp(content), MEDIA[".webp"]), key=lambda one: len(one[0]))
    return block(
        "image", source=data_address(content, kind), alt=file.stem, kind="drawn" if file.suffix == ".png" else ""
    )


def _as_webp(content: bytes) -> bytes:
    """A picture as WebP: without loss, or nearly so where that takes half the bytes at most, as it does with relief."""
    from PIL import Image

    exact, near = io.BytesIO(), io.BytesIO()
    with Image.open(io.BytesIO(content)) as image:
        image.save(exact, "WEBP", lossless=True)
        image.save(near, "WEBP", quality=PICTURE_QUALITY)
    is_near = 2 * near.tell() <= exact.tell()
    return (near if is_near else exact).getvalue()


def data_address(content: bytes, kind: str) -> str:
    """Address that holds ``content`` itself, of a media type such as ``image/png``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def interactive_plot(figure: Any, **layout: Any) -> Markup:
    """HTML of a figure of plotly's in the colours of all others, with titles left above their plots.

    Args:
        figure: Of subplots with titles.
        layout: Of the figure besides.
    """
    for index, annotation in enumerate(figure.layout.annotations):
        annotation.x = figure.layout["xaxis" + ("" if index == 0 else str(index + 1))].domain[0]
    figure.update_annotations(xanchor="left", font={"size": 14, "color": INK})
    figure.update_xaxes(gridcolor=GRID, linecolor=SOFT, zeroline=False)
    figure.update_yaxes(gridcolor=GRID, linecolor=SOFT, zerolinecolor=GRID)
    figure.update_layout(
        paper_bgcolor="white",
        plot_bgcolor="white",
        hovermode="x unified",
        font={"color": INK, "family": "system-ui, -apple-system, Segoe UI, DejaVu Sans, sans-serif", "size": 12},
        **layout,
    )
    config = {"displaylogo": False, "responsive": True, "modeBarButtonsToRemove": ["sendChartToCloud"]}
    content = json.loads(figure.to_json())
    height = f"{figure.layout.height}px" if figure.layout.height else "100%"
    return block("plot", content=packed(json.dumps(content | {"config": config})), height=height)


def write_animation(stem: Path, frames: Sequence[NDArray[np.uint8]], *, frames_per_second: float) -> Path:
    """Write ``frames`` (height, width, 3) as an animation that repeats: AVIF, or WebP where Pillow came without AVIF.

    Args:
        stem: Of the file, without its suffix.
        frames: Of one size.
        frames_per_second: Of the animation.

    Returns the file.
    """
    from PIL import Image, features

    kind, how = ("AVIF", {"speed": AVIF_SPEED}) if features.check("avif") else ("WEBP", {})
    path = stem.with_name(f"{stem.name}.{kind.lower()}")
    first, *others = (Image.fromarray(frame) for frame in frames)
    several: Any = {"save_all": True, "append_images": others, "duration": round(1000.0 / frames_per_second), "loop": 0}
    with written_whole(path) as temporary:
        first.save(temporary, kind, quality=FILM_QUALITY, **several, **how)
    return path


def describe(key: str) -> tuple[str, str, int]:
    """Name, unit and decimals of a key figure, from its key: ``turn_time_s`` is ('turn time', 's', 3)."""
    units = {"L_per_min": ("L/min", 1), "m_per_s": ("m/s", 3), "bar": ("bar", 1), "deg": ("°", 2), "rpm": ("rpm", 0)}
    units |= {"m": ("m", 2), "s": ("s", 3), "kN": ("kN", 2)}
    for suffix, (unit, decimals) in units.items():
        if key.endswith(f"_{suffix}"):
            return key.removesuffix(f"_{suffix}").replace("_", " "), unit, decimals
    return key.replace("_", " "), "", 3


def show(key: str, value: float | None) -> str:
    """A key figure's value at its decimals, without the unit."""
    return "-" if value is None else f"{value:.{describe(key)[2]}f}"


def tiles(figures: Mapping[str, float | None]) -> Markup:
    """Key figures on a tile each."""
    return block(
        "tiles", figures=[(show(key, value), describe(key)[1], describe(key)[0], "") for key, value in figures.items()]
    )
