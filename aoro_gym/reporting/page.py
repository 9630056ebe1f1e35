"""Reports as one self-contained HTML page that works without a network: passages, cards, pictures, interactive plots."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import write_text, written_whole
from aoro_gym.reporting.style import GRID, INK, SOFT
from aoro_gym.version import VERSION


@dataclass(frozen=True)
class Passage:
    """A part of a page that is no recording: text, a table and pictures."""

    title: str
    text: str
    pictures: Sequence[Path] = ()
    """PNG, GIF or MP4 files; the page holds copies."""
    more: str = ""
    """Address of a page that says more."""
    table: Sequence[Sequence[str]] = ()
    """Rows of cells; the first one is the head."""


def passage_section(passage: Passage) -> tuple[str, str]:
    """Title and HTML of a passage, as :func:`write_page` takes them."""
    more = f' <a href="{html.escape(passage.more)}">All of it</a>' if passage.more else ""
    pictures = "".join(card(picture(file)) for file in passage.pictures)
    return passage.title, f"<p>{html.escape(passage.text)}{more}</p>{_table(passage.table)}{pictures}"


def write_page(
    path: Path,
    title: str,
    lead: str,
    sections: Iterable[tuple[str, str]],
    *,
    top: str = "",
    footer: str = "",
    interactive: bool = True,
) -> None:
    """Write one page; it needs no other file and no network.

    Args:
        path: File to write.
        title: Of the page.
        lead: A sentence below it.
        sections: Title and HTML of each.
        top: HTML that stands above them.
        footer: A sentence at the end.
        interactive: Whether it holds plots of plotly, whose code takes megabytes.
    """
    from plotly.offline import get_plotlyjs

    template = Template(
        resources.files("aoro_gym.reporting").joinpath("templates/report.html").read_text(encoding="utf-8")
    )
    bodies, links = [], []
    for index, (heading, body) in enumerate(sections):
        name, heading = f"section-{index + 1}", html.escape(heading)
        links.append(f'<a href="#{name}">{heading}</a>')
        bodies.append(f'<section id="{name}"><h2>{heading}</h2>{body}</section>')
    page = template.substitute(
        title=html.escape(title),
        lead=html.escape(lead),
        contents="".join(links) if len(links) > 1 else "",
        sections="\n".join([top, *bodies]),
        plotly=get_plotlyjs() if interactive else "",
        footer=html.escape(f"Drawn by aoro-gym {VERSION}. {footer}"),
    )
    write_text(path, page)


def card(content: str) -> str:
    """HTML on a card of its own."""
    return f'<div class="card">{content}</div>'


def picture(path: Path) -> str:
    """HTML of an image or a film that stands in the page itself."""
    content = base64.b64encode(path.read_bytes()).decode("ascii")
    kind = path.suffix.removeprefix(".")
    if kind == "mp4":
        return f'<video controls autoplay muted loop playsinline src="data:video/mp4;base64,{content}"></video>'
    return f'<img alt="{html.escape(path.stem)}" src="data:image/{kind};base64,{content}">'


def interactive_plot(figure: Any, **layout: Any) -> str:
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
    return figure.to_html(full_html=False, include_plotlyjs=False, config=config)


def write_gif(path: Path, frames: Sequence[NDArray[np.uint8]], *, frames_per_second: float) -> None:
    """Write ``frames`` (height, width, 3) as an animation that repeats; a GIF counts in hundredths of a second."""
    from PIL import Image

    # one palette for all: of the last frame, whose traces are full
    palette = Image.fromarray(frames[-1]).quantize(64)
    pictures = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    hundredths = max(2, round(100.0 / frames_per_second))
    with written_whole(path) as temporary:
        pictures[0].save(
            temporary, save_all=True, append_images=pictures[1:], duration=10 * hundredths, loop=0, optimize=False
        )


def describe(key: str) -> tuple[str, str, int]:
    """Name, unit and decimals of a key figure, from its key: ``turn_time_s`` is ('turn time', 's', 3)."""
    units = {"L_per_min": ("L/min", 1), "m_per_s": ("m/s", 3), "bar": ("bar", 1), "deg": ("°", 2), "rpm": ("rpm", 0)}
    units |= {"m": ("m", 2), "s": ("s", 3)}
    for suffix, (unit, decimals) in units.items():
        if key.endswith(f"_{suffix}"):
            return key.removesuffix(f"_{suffix}").replace("_", " "), unit, decimals
    return key.replace("_", " "), "", 3


def show(key: str, value: float | None) -> str:
    """A key figure's value at its decimals, without the unit."""
    return "-" if value is None else f"{value:.{describe(key)[2]}f}"


def _table(rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    head, *body = (
        "".join(f"<{cell}>{html.escape(text)}</{cell}>" for text in row)
        for cell, row in zip(("th", *("td" for _ in rows[1:])), rows, strict=True)
    )
    lines = "".join(f"<tr>{line}</tr>" for line in body)
    return card(f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>")


def tile(key: str, value: float | None) -> str:
    """HTML of a key figure on a tile."""
    name, unit, _ = describe(key)
    return f'<div class="figure"><b>{show(key, value)} <small>{unit}</small></b><span>{html.escape(name)}</span></div>'
