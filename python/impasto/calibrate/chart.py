"""A ColorChecker in a photograph: where it is, and the light of its 24 patches.

The chart is found by OpenCV's detector of colour charts, or given by the middles of its corner
patches; a homography [@hartley2004multiple] leads to all others. Which way round it lies is told by
the colours: the order in which they fit the measured ones best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import numbers
from impasto.colour import xyz_from_spectrum
from impasto.colour._science import science
from impasto.errors import ArgumentError

REFERENCE = "BabelColor Average"
"""The mean of 30 charts, in colour-science: the reflectances that a chart has unless given."""
COLUMNS, ROWS = 6, 4
GRID = np.arange(400.0, 701.0, 10.0)
"""nm: where reflectances and sensitivities are sampled."""
LONGEST = 1500
"""Pixels of the longer side of the picture in which the chart is looked for."""
HALF_SIDE = 0.22
"""Half a side of what is read of a patch, in distances between two patches."""
LEAST = 4
"""Fewest pixels across what is read of a patch."""
UNEVEN = 0.15
"""A patch whose light varies by more of itself has something on it, or is not where it seems."""
ENOUGH = 16
"""Fewest patches that are left of 24."""
ALIKE = 0.8
"""Least share of the variance of the chart's colours that a chart's photograph explains."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chart:
    """What a photograph shows of a ColorChecker.

    Parameters
    ----------
    corners
        ``(4, 2)`` pixels: the middles of dark skin, bluish green, black and white.
    places
        ``(24, 2)`` pixels: the middles of all patches, row by row from dark skin to black.
    light
        ``(24, band)`` linear light, medians.
    sigma
        ``(24, band)`` standard deviations of these medians.
    used
        ``(24,)``: neither clipped nor uneven.
    """

    corners: Array
    places: Array
    light: Array
    sigma: Array
    used: NDArray[np.bool_]


def patch_names() -> tuple[str, ...]:
    """The names of the 24 patches, from dark skin to black."""
    return tuple(str(name) for name in science().SDS_COLOURCHECKERS[REFERENCE])


def chart_reflectances() -> Array:
    """``(24, n)`` reflectances of the patches on :data:`GRID`."""
    patches = science().SDS_COLOURCHECKERS[REFERENCE].values()
    return np.array([np.interp(GRID, one.wavelengths, one.values) for one in patches])


def read_chart(linear: NDArray[Any], where: str, corners: ArrayLike | None = None) -> Chart:
    """Find a ColorChecker and read its patches.

    Parameters
    ----------
    linear
        ``(band, y, x)`` linear light; 1 is clipped.
    where
        The photograph, for messages.
    corners
        ``(4, 2)`` x and y in pixels of the middles of dark skin, bluish green, black and white;
        None: the chart is found.

    Raises
    ------
    ArgumentError
        No chart, one that lies outside the photograph, too small, overexposed, or of other colours.
    """
    light = np.asarray(linear, dtype=np.float64)
    given = corners is not None
    found = _checked(corners, light.shape[1:], where) if given else _detected(light, where)
    chart = _read(light, found, where)
    rotated = found if given else np.roll(found, 2, axis=0)
    other = chart if given else _read(light, rotated, where)
    fits = [_likeness(one) for one in (chart, other)]
    best = chart if fits[0] >= fits[1] else other
    if best.used.sum() < ENOUGH:
        raise ArgumentError(
            f"{where}: only {best.used.sum()} of 24 patches are neither clipped nor uneven, "
            f"{ENOUGH} are needed; expose less, and keep shadows and reflections off the chart"
        )
    if max(fits) < ALIKE:
        raise ArgumentError(
            f"{where}: the colours of the chart explain {100 * max(fits):.0f} % of those of a "
            f"ColorChecker, at least {100 * ALIKE:.0f} % are needed; give its corners "
            "(--corners), and the encoding of the photograph"
        )
    return best


def _checked(corners: Any, size: tuple[int, ...], where: str) -> Array:
    found = numbers(corners, "corners", "four pairs x, y in pixels")
    inside = found.shape == (4, 2) and np.isfinite(found).all() and (found >= 0).all()
    if not (inside and (found < (size[1], size[0])).all()):
        raise ArgumentError(
            f"corners: expected x and y of four patches within {size[1]} x {size[0]} pixels of "
            f"{where}, found {np.asarray(corners).tolist()}"
        )
    return found


def _detected(light: Array, where: str) -> Array:
    """The middles of the corner patches, one way round or the other."""
    import cv2

    none = ArgumentError(
        f"{where}: no ColorChecker found; give the middles of its corner patches, dark skin, "
        "bluish green, black and white (corners=)"
    )
    if len(light) < 3:
        raise none
    bright = np.quantile(light[:3], 0.995, axis=(1, 2), keepdims=True)
    codes = np.rint(255.0 * np.sqrt(np.clip(light[:3] / np.maximum(bright, 1e-30), 0.0, 1.0)))
    picture = np.ascontiguousarray(np.moveaxis(codes[::-1], 0, -1).astype(np.uint8))
    scale = min(1.0, LONGEST / max(picture.shape[:2]))
    if scale < 1.0:
        picture = np.asarray(
            cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        )
    mcc: Any = cv2.mcc
    detector = mcc.CCheckerDetector_create()
    detector.setColorChartType(mcc.MCC24)
    if not detector.process(picture):
        raise none
    chart = detector.getBestColorChecker()
    patches = np.asarray(chart.getColorCharts(), dtype=np.float64).reshape(-1, 4, 2).mean(axis=1)
    if len(patches) != ROWS * COLUMNS:
        raise none
    corners = patches[[0, COLUMNS - 1, ROWS * COLUMNS - 1, ROWS * COLUMNS - COLUMNS]]
    return np.asarray((corners + 0.5) / scale - 0.5)


def _read(light: Array, corners: Array, where: str) -> Chart:
    import cv2

    ends = np.array(
        [[0, 0], [COLUMNS - 1, 0], [COLUMNS - 1, ROWS - 1], [0, ROWS - 1]], dtype=np.float32
    )
    to_picture = np.asarray(cv2.getPerspectiveTransform(ends, corners.astype(np.float32)))
    rows, columns = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    middles = np.stack([columns, rows], axis=1).astype(np.float64)
    places = _mapped(to_picture, middles)
    across = _mapped(to_picture, middles + np.array([2 * HALF_SIDE, 0.0])) - places
    side = np.linalg.norm(across, axis=1)
    if side.min() < LEAST:
        raise ArgumentError(
            f"{where}: the patches of the chart are {side.min() / (2 * HALF_SIDE):.0f} pixels "
            f"apart, at least {LEAST / (2 * HALF_SIDE):.0f} are needed"
        )
    count = int(np.clip(np.ceil(side.max()), LEAST, 64))
    steps = (np.arange(count) + 0.5) / count * 2 * HALF_SIDE - HALF_SIDE
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)
    at = _mapped(to_picture, (middles[:, None] + grid).reshape(-1, 2))
    column, row = np.rint(at).astype(np.int64).T
    height, width = light.shape[1:]
    if not ((column >= 0) & (column < width) & (row >= 0) & (row < height)).all():
        raise ArgumentError(f"{where}: a part of the chart lies outside the photograph")
    values = light[:, row, column].reshape(len(light), ROWS * COLUMNS, -1)
    middle = np.median(values, axis=2)
    spread = 1.4826 * np.median(np.abs(values - middle[..., None]), axis=2)
    # The standard deviation of a median is sqrt(pi / 2) times that of a mean.
    sigma = np.sqrt(np.pi / 2.0) * spread / count
    clipped = (values >= 1.0).mean(axis=2).max(axis=0) > 0.01
    uneven = (spread > UNEVEN * np.maximum(middle, 0.02 * middle.max())).any(axis=0)
    known = np.isfinite(middle).all(axis=0)
    return Chart(corners, places, middle.T, sigma.T, known & ~clipped & ~uneven)


def _mapped(homography: Array, points: Array) -> Array:
    whole = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ homography.T
    return np.asarray(whole[:, :2] / whole[:, 2:])


def _likeness(chart: Chart) -> float:
    """Share of the variance of a chart's colours in daylight that a matrix explains."""
    light, used = chart.light, chart.used
    if used.sum() < ENOUGH:
        # Clipped patches are still the brightest ones.
        used = np.asarray(np.isfinite(light).all(axis=1))
    colours = chart_reflectances()[used] @ xyz_from_spectrum(GRID, "D65").T
    matrix = np.linalg.lstsq(light[used], colours, rcond=None)[0]
    left = np.square(colours - light[used] @ matrix).sum()
    return float(1.0 - left / np.square(colours - colours.mean(axis=0)).sum())
