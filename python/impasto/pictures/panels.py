"""Pictures of result maps for viewing; for data, use the maps.

Every map becomes 8-bit RGB ``(y, x, 3)``: normals as (n + 1) / 2, colours with the sRGB curve,
quantities on one perceptual colour ramp, statuses in flat colours. Pixels whose value is unknown
(NaN) show a dark checkerboard.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.status import Status

Picture: TypeAlias = NDArray[np.uint8]
"""8-bit sRGB, ``(y, x, 3)``."""

BACKGROUND = (28, 28, 30)
INK = (232, 230, 225)
FAINT = (150, 149, 146)

STATUS_COLOURS: dict[Status, tuple[int, int, int]] = {
    Status.FITTED: (64, 98, 92),
    Status.RELAXED: (122, 158, 126),
    Status.EXACT: (196, 190, 142),
    Status.ILL_CONDITIONED: (222, 160, 92),
    Status.POOLED: (92, 128, 164),
    Status.DARK: (20, 20, 22),
    Status.SATURATED: (240, 236, 226),
    Status.TOO_FEW_SAMPLES: (188, 92, 72),
    Status.RANK_DEFICIENT: (146, 72, 104),
    Status.INVALID_INPUT: (220, 50, 80),
    Status.MASKED: (52, 52, 56),
    Status.NOT_COMPUTED: (110, 110, 114),
}
"""Estimated pixels in muted greens and blues; statuses that need attention in warm colours."""


@dataclass(frozen=True, eq=False)
class Panel:
    """One picture of a contact sheet.

    Parameters
    ----------
    title
        What the picture shows, in a few words.
    picture
        ``(y, x, 3)`` uint8.
    note
        Unit or scale, in small type at the right of the title.
    bar
        Labels at the two ends of the colour ramp, or None for pictures without a ramp.
    classes
        (name, colour) of each flat colour, or empty.
    axis
        Labels at the two ends of a diagram's horizontal axis, or None.
    """

    title: str
    picture: Picture
    note: str = ""
    bar: tuple[str, str] | None = None
    classes: tuple[tuple[str, tuple[int, int, int]], ...] = ()
    axis: tuple[str, str] | None = None


def normal_panel(normal: ArrayLike, title: str = "Surface normal") -> Panel:
    """Normals ``(3, y, x)`` as colours: red = x (right), green = y (up), blue = z (to you)."""
    normal = _planes(normal, "normal", (3,))
    return Panel(title, _painted((normal + 1.0) / 2.0), "red right, green up, blue towards you")


def colour_panel(linear: ArrayLike, title: str, *, note: str = "", white: float = 1.0) -> Panel:
    """Linear bands ``(band, y, x)`` with the sRGB curve; ``white`` is shown as full white.

    Three bands are red, green and blue. Of any other number, the last, the middle and the first are
    used instead, because bands are stored in order of wavelength.
    """
    linear = _planes(linear, "linear")
    count = len(linear)
    if count != 3:
        linear = linear[[count - 1, count // 2, 0]]
    return Panel(title, _painted(Encoding("srgb").encode(linear / white), linear), note)


def ramp_panel(
    plane: ArrayLike,
    title: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    scale: float = 1.0,
) -> Panel:
    """One quantity ``(y, x)`` on the colour ramp.

    Parameters
    ----------
    plane
        ``(y, x)``; NaN where unknown.
    title, unit
        Name of the quantity and its unit.
    low, high
        Ends of the ramp in the printed unit; default: the 1st and the 99th percentile, so that a
        few outliers do not darken the picture. Both ends are printed below it.
    scale
        Factor from the stored to the printed unit (radians to degrees, for example).
    """
    values = np.asarray(plane, dtype=np.float32) * np.float32(scale)
    if values.ndim != 2:
        raise ArgumentError(f"plane: expected (y, x), found shape {values.shape}")
    known = values[np.isfinite(values)]
    if known.size:
        low = float(np.percentile(known, 1)) if low is None else low
        high = float(np.percentile(known, 99)) if high is None else high
    low, high = (0.0 if low is None else low), (1.0 if high is None else high)
    span = high - low if high > low else 1.0
    index = np.clip((np.nan_to_num(values, nan=low) - low) / span, 0.0, 1.0) * 255.0
    picture = colour_ramp()[np.rint(index).astype(np.uint8)]
    return Panel(
        title, _checkered(picture, np.isfinite(values)), unit, (_number(low), _number(high))
    )


def status_panel(status: ArrayLike, title: str = "Status") -> Panel:
    """Statuses ``(y, x)`` in flat colours; the legend gives the share of pixels of each."""
    codes = np.asarray(status, dtype=np.uint8)
    if codes.ndim != 2:
        raise ArgumentError(f"status: expected (y, x), found shape {codes.shape}")
    table = np.full((256, 3), (255, 0, 255), dtype=np.uint8)
    for member, colour in STATUS_COLOURS.items():
        table[member] = colour
    counts = np.bincount(codes.ravel(), minlength=256)
    order = sorted(np.flatnonzero(counts).tolist(), key=lambda code: -int(counts[code]))
    classes = tuple(
        (f"{_status_name(code)} {_share(counts[code] / codes.size)}", _rgb(table[code]))
        for code in order
    )
    return Panel(title, table[codes], classes=classes)


def curve_panel(
    points: ArrayLike,
    line: ArrayLike,
    title: str,
    *,
    note: str = "",
    axis: tuple[str, str] | None = None,
    size: tuple[int, int] = (460, 460),
) -> Panel:
    """Measured points and the fitted curve.

    Parameters
    ----------
    points, line
        ``(n, 2)``: x and y of each point, and of the curve in order of x. Both axes start at 0 and
        end at the largest value in ``line``.
    title, note, axis
        See :class:`Panel`.
    size
        ``(y, x)`` of the picture.
    """
    import cv2

    measured, fitted_line = (np.asarray(a, dtype=np.float64).reshape(-1, 2) for a in (points, line))
    rows, columns = size
    picture = np.empty((rows, columns, 3), dtype=np.uint8)
    picture[:] = (38, 38, 41)
    known = fitted_line[np.isfinite(fitted_line).all(axis=1)]
    right, high = (known.max(axis=0) if len(known) else np.ones(2)).tolist()
    # A margin above the curve for points above it; 4 fractional bits for smooth lines.
    scale = 16.0 * np.array([columns / max(right, 1e-12), -0.8 * rows / max(high, 1e-12)])
    origin = 16.0 * np.array([0.0, rows - 12.0])

    def pixels(values: NDArray[np.float64]) -> NDArray[np.int32]:
        inside = values[np.isfinite(values).all(axis=1) & (values[:, 0] <= right)]
        reach = 16.0 * 4.0 * max(size)
        return np.rint(np.clip(inside * scale + origin, -reach, reach)).astype(np.int32)

    base = round(origin[1] / 16.0)
    picture[base : base + 1] = (86, 86, 90)
    for x, y in pixels(measured).tolist():
        cv2.circle(picture, (x, y), 16 * 4, _rgb(colour_ramp()[176]), -1, cv2.LINE_AA, 4)
    if len(known) > 1:
        cv2.polylines(picture, [pixels(known)], False, INK, 2, cv2.LINE_AA, 4)
    return Panel(title, picture, note, axis=axis)


@cache
def colour_ramp() -> Picture:
    """256 colours ``(256, 3)`` from dark violet over teal to pale yellow.

    Even steps of lightness and hue at constant chroma in OKLab (Ottosson 2020). Equal differences
    look equal, and lightness alone shows the order: in grey print, and to colour-blind readers.
    """
    t = np.linspace(0.0, 1.0, 256)
    lightness = 0.24 + 0.70 * t
    chroma = 0.092  # the largest that sRGB contains along the whole path; teal limits it
    hue = np.radians(300.0 - 195.0 * t)
    lab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)])
    cone = np.array(
        [
            [1.0, 0.3963377774, 0.2158037573],
            [1.0, -0.1055613458, -0.0638541728],
            [1.0, -0.0894841775, -1.2914855480],
        ]
    )
    rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    linear = rgb @ (cone @ lab) ** 3
    return np.rint(Encoding("srgb", 255.0).encode(linear)).astype(np.uint8).T.copy()


def _painted(rgb: NDArray[np.floating[Any]], known: NDArray[Any] | None = None) -> Picture:
    finite = np.isfinite(rgb if known is None else known).all(axis=0)
    codes = np.rint(np.clip(np.nan_to_num(rgb, nan=0.0), 0.0, 1.0) * 255.0).astype(np.uint8)
    return _checkered(np.ascontiguousarray(np.moveaxis(codes, 0, -1)), finite)


def _checkered(picture: Picture, known: NDArray[np.bool_]) -> Picture:
    if known.all():
        return picture
    rows, columns = np.indices(known.shape) // 8
    board = np.where((rows + columns) % 2 == 0, 58, 74).astype(np.uint8)
    return np.where(known[..., None], picture, board[..., None])


def _planes(
    values: ArrayLike, name: str, count: tuple[int, ...] | None = None
) -> NDArray[np.float32]:
    array = np.asarray(values, dtype=np.float32)
    if array.ndim != 3 or (count is not None and len(array) not in count):
        raise ArgumentError(f"{name}: expected planes (band, y, x), found shape {array.shape}")
    return array


def _status_name(code: int) -> str:
    try:
        return Status(code).name.replace("_", " ").lower()
    except ValueError:
        return f"status {code}"


def _share(fraction: float) -> str:
    if fraction >= 0.9995:
        return "100 %"
    return f"{100 * fraction:.1f} %" if fraction >= 0.0005 else "< 0.1 %"


def _number(value: float) -> str:
    return f"{value:.3g}"


def _rgb(row: NDArray[np.uint8]) -> tuple[int, int, int]:
    return (int(row[0]), int(row[1]), int(row[2]))
