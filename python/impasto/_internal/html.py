"""What a notebook shows of a stack, a result or a picture: a small table and a thumbnail."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding

THUMBNAIL = 240
"""Pixels of the longer side of a thumbnail: it stands beside ten lines of text."""


def png(picture: NDArray[np.uint8]) -> bytes:
    """An 8-bit picture ``(y, x, 3)`` as the bytes of a PNG file."""
    import cv2

    done, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    if not done:
        raise ValueError(f"a picture of shape {picture.shape} cannot be written as PNG")
    return data.tobytes()


def thumbnail(linear: NDArray[Any]) -> NDArray[np.uint8]:
    """Linear light ``(band, y, x)`` as a small sRGB picture; NaN is black.

    Three bands are red, green and blue; of any other number the mean is shown. Its 99th percentile
    is white.
    """
    step = max(1, max(linear.shape[1:]) // THUMBNAIL)
    small = np.asarray(linear[:, ::step, ::step], dtype=np.float32)
    small = small if len(small) == 3 else np.repeat(small.mean(axis=0)[None], 3, axis=0)
    known = small[np.isfinite(small)]
    white = float(np.quantile(known, 0.99)) if known.size else 0.0
    shown = np.nan_to_num(small / white if white > 0.0 else small, nan=0.0, posinf=1.0, neginf=0.0)
    codes = Encoding("srgb", 255.0).encode(np.clip(shown, 0.0, 1.0))
    return np.rint(np.moveaxis(codes, 0, -1)).astype(np.uint8)


def table(title: str, rows: Mapping[str, object], *pictures: NDArray[np.uint8]) -> str:
    """HTML: a title, rows of names and values, and pictures beside them."""
    lines = "".join(
        f"<tr><td style='text-align:left;opacity:.65;padding-right:1em'>{html.escape(name)}</td>"
        f"<td style='text-align:left'>{html.escape(str(value))}</td></tr>"
        for name, value in rows.items()
    )
    shown = "".join(
        "<img style='max-height:15em;margin-left:1em' alt='' "
        f"src='data:image/png;base64,{base64.b64encode(png(picture)).decode()}'>"
        for picture in pictures
    )
    return (
        "<div style='display:flex;align-items:flex-start'>"
        f"<table><caption style='text-align:left'><b>{html.escape(title)}</b></caption>{lines}"
        f"</table>{shown}</div>"
    )
