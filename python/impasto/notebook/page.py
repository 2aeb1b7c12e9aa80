"""Pieces of notebook views: a small table and thumbnails, in the colours of the page.

Text is escaped, pictures are in the page itself, and nothing is requested from anywhere.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.png import png
from impasto.encoding import Encoding

THUMBNAIL = 240
"""Pixels of the longer side of a thumbnail on the page, about ten lines of text."""
LARGEST_BYTES = 160_000
"""Of a picture in the page, as PNG; a notebook keeps every one of them in its file."""
_SHARP = 2.0
"""Enlarged by more than this, pixels keep sharp edges: interpolation would hide them."""


def reduced(planes: NDArray[Any]) -> NDArray[Any]:
    """Every so many pixels of ``(..., y, x)``: 240 to 479 along the longer side, if there are."""
    step = max(1, max(planes.shape[-2:]) // THUMBNAIL)
    return planes[..., ::step, ::step]


def thumbnail(linear: NDArray[Any]) -> NDArray[np.uint8]:
    """Linear light ``(band, y, x)`` as a small sRGB picture; NaN is black.

    Three bands are red, green and blue; of any other number the mean is shown. Its 99th percentile
    is white.
    """
    small = np.asarray(reduced(linear), dtype=np.float32)
    small = small if len(small) == 3 else np.repeat(small.mean(axis=0)[None], 3, axis=0)
    known = small[np.isfinite(small)]
    white = float(np.quantile(known, 0.99)) if known.size else 0.0
    shown = np.nan_to_num(small / white if white > 0.0 else small, nan=0.0, posinf=1.0, neginf=0.0)
    codes = Encoding("srgb", 255.0).encode(np.clip(shown, 0.0, 1.0))
    return np.rint(np.moveaxis(codes, 0, -1)).astype(np.uint8)


def normal_thumbnail(normal: NDArray[Any]) -> NDArray[np.uint8]:
    """Normals ``(3, y, x)`` as a small picture, (n + 1) / 2; NaN is black."""
    codes = 255.0 * np.nan_to_num((reduced(normal) + 1.0) / 2.0, nan=0.0)
    return np.rint(np.moveaxis(codes, 0, -1)).astype(np.uint8)


def share_of(part: NDArray[np.bool_]) -> str:
    """``99.8 %``: the share of True."""
    return f"{100 * float(part.mean()):.1f} %"


def table(title: str, rows: Mapping[str, object], pictures: Mapping[str, NDArray[np.uint8]]) -> str:
    """HTML: a title, rows of names and values, and pictures with their names beside them.

    Colours are those of the page, light or dark; on a narrow page pictures move below the table.
    """
    lines = "".join(
        _line((name, value), (f"{_CELL};opacity:.65;white-space:nowrap", _CELL))
        for name, value in rows.items()
    )
    figures = "".join(_figure(name, picture) for name, picture in pictures.items())
    return (
        "<div style='display:flex;flex-wrap:wrap;align-items:flex-start;gap:.5em 1.5em'>"
        f"<table style='margin:0;max-width:26em;border-collapse:collapse'>{_caption(title)}"
        f"{lines}</table>"
        f"<div style='display:flex;flex-wrap:wrap;gap:.5em 1em'>{figures}</div></div>"
    )


def grid(title: str, heads: Sequence[str], rows: Sequence[Sequence[object]], note: str = "") -> str:
    """HTML: a title, a table with a head for each column, and a note below it."""
    head = _line(heads, [f"{_CELL};opacity:.65;white-space:nowrap"] * len(heads))
    lines = "".join(_line(row, [_CELL] * len(heads)) for row in rows)
    below = f"<div style='opacity:.65;font-size:.9em'>{html.escape(note)}</div>" if note else ""
    return (
        "<div style='overflow-x:auto'><table style='margin:0;border-collapse:collapse'>"
        f"{_caption(title)}{head}{lines}</table>{below}</div>"
    )


_CELL = "text-align:left;vertical-align:top;padding:.1em 1em .1em 0;background:none"
"""Notebooks have style sheets of their own for tables, so every cell says how it is set."""


def _line(cells: Sequence[object], styles: Sequence[str]) -> str:
    found = "".join(
        f"<td style='{style}'>{html.escape(str(cell))}</td>"
        for cell, style in zip(cells, styles, strict=True)
    )
    return f"<tr style='background:none'>{found}</tr>"


def _caption(title: str) -> str:
    style = "caption-side:top;text-align:left;color:inherit;padding:0 0 .3em"
    return f"<caption style='{style}'><b>{html.escape(title)}</b></caption>"


def _within_limit(picture: NDArray[np.uint8]) -> bytes:
    """The picture as PNG, with half of its rows and columns until it is small enough."""
    data = png(picture)
    while len(data) > LARGEST_BYTES and min(picture.shape[:2]) > 1:
        picture = picture[::2, ::2]
        data = png(picture)
    return data


def _figure(name: str, picture: NDArray[np.uint8]) -> str:
    height, width = picture.shape[:2]
    scale = THUMBNAIL / max(height, width)
    sharp = "image-rendering:pixelated;" if scale > _SHARP else ""
    return (
        "<figure style='margin:0;max-width:100%'><img alt='' style='display:block;margin:0;"
        f"max-width:100%;width:{max(1, round(scale * width))}px;height:auto;{sharp}' "
        f"src='data:image/png;base64,{base64.b64encode(_within_limit(picture)).decode()}'>"
        f"<figcaption style='opacity:.65;font-size:.9em'>{html.escape(name)}</figcaption></figure>"
    )
