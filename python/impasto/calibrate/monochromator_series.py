"""A series of narrow-band photographs: its table, and the mean light of the area that is lit."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import read_text
from impasto.io.images import ImageHeader, list_images, load_image
from impasto.io.images.exif import read_exif
from impasto.io.notes import few
from impasto.io.session.frames import FrameSource, read_dark
from impasto.io.session.linear_codes import clipping_code, full_scale, stored_curve

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Window = tuple[int, int, int, int]
"""Top, left, height and width in pixels."""

NEEDED = ("photograph", "wavelength", "bandwidth", "power")
OPTIONAL = ("power_sigma", "seconds")
LIT = 0.5
"""Light of the area that is read, relative to its brightest part in the sum of the series."""
LEAST = 16
"""Pixels that are enough for a mean and its noise."""
CLIPPED = 0.001
"""Share of clipped samples from which a mean is wrong by as much."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Means of a series.

    Attributes
    ----------
    source
        The table.
    names
        Of the ``n`` photographs.
    wavelengths, bandwidths, power
        ``(n,)`` nm, nm, and radiant power times exposure time.
    light
        ``(n, band)`` mean of linear light above black, full scale 1.
    values, variance
        ``(n, band)`` light per unit of power and second, and the variance of that.
    clipped
        ``(n, band)`` whether more than 0.1 % of the samples are clipped.
    lit
        ``(y, x)`` the area that was read.
    """

    source: str
    names: tuple[str, ...]
    wavelengths: Floats
    bandwidths: Floats
    power: Floats
    light: Floats
    values: Floats
    variance: Floats
    clipped: Mask
    lit: Mask


def read_series(
    folder: Path,
    series: Path,
    *,
    dark: FrameSource | None,
    region: Window | None,
    encoding: str | None,
    saturation: float | None,
) -> Reading:
    """See :func:`impasto.calibrate.camera_from_monochromator`."""
    if not folder.is_dir():
        raise ArgumentError(f"path: {folder} is not a folder")
    table = _table(series)
    paths = _paths(folder, series, [row[0] for row in table])
    numbers = np.array([row[1:] for row in table])
    seconds = _seconds(paths, numbers[:, 4])
    header, first = load_image(paths[0])
    black = _black(dark, header, first.shape, encoding)
    lit = _area(first.shape, region) if region is not None else None
    if lit is None:
        total = np.zeros(first.shape[1:])
        for path, power in zip(paths, (numbers[:, 2] * seconds).tolist(), strict=True):
            light = _light(path, header, encoding, black)
            total += np.maximum(light, 0.0).sum(axis=0) / power
        lit = _lit(total, folder)
    # The pixels that are read lie along the longer side of the area, where light changes least.
    wide, high = (int(np.ptp(axis)) + 1 for axis in np.nonzero(lit)[::-1])
    along = lit if wide >= high else lit.T
    pairs = along[:, 1:] & along[:, :-1]
    code = clipping_code(saturation, header) if saturation is not None else _full(header)
    means, variance, clipped = [], [], []
    for path in paths:
        planes = _light(path, header, encoding, black)
        codes = load_image(path)[1]
        seen = planes if wide >= high else planes.transpose(0, 2, 1)
        steps = np.square(seen[:, :, 1:] - seen[:, :, :-1])[:, pairs]
        means.append(planes[:, lit].mean(axis=1))
        variance.append(0.5 * steps.mean(axis=1) / lit.sum())
        clipped.append((codes[:, lit] >= code).mean(axis=1) > CLIPPED)
    exposed = numbers[:, 2] * seconds
    # Codes are whole numbers: rounding alone makes an error of 1 / sqrt(12) codes.
    rounded = 1.0 / (12.0 * _full(header) ** 2 * lit.sum()) if header.dtype.kind == "u" else 0.0
    spread = (np.array(variance) + rounded) / np.square(exposed)[:, None]
    mean = np.array(means)
    values = mean / exposed[:, None]
    spread += np.square(values * (numbers[:, 3] / numbers[:, 2])[:, None])
    return Reading(
        str(series), tuple(path.name for path in paths), numbers[:, 0], numbers[:, 1], exposed,
        mean, values, np.maximum(spread, np.finfo(np.float64).tiny), np.array(clipped), lit,
    )  # fmt: skip


def _table(path: Path) -> list[tuple[Any, ...]]:
    """Name, wavelength, bandwidth, power, its standard deviation, and seconds or NaN."""
    rows = list(csv.reader(io.StringIO(read_text(path))))
    head = [word.strip().lower() for word in rows[0]] if rows else []
    known = {*NEEDED, *OPTIONAL}
    if not set(NEEDED) <= set(head) <= known or len(set(head)) < len(head):
        raise CorruptInputError(
            path, f"line 1: expected the columns {','.join(NEEDED)} and, if known, "
            f"{' and '.join(OPTIONAL)}; found {','.join(head) or 'nothing'}"
        )  # fmt: skip
    found = []
    for line, row in enumerate(rows[1:], 2):
        if not any(word.strip() for word in row):
            continue
        cells = dict(zip(head, (word.strip() for word in row), strict=False))
        try:
            wavelength, bandwidth, power = (float(cells[name]) for name in NEEDED[1:])
            sigma = float(cells.get("power_sigma", 0.0))
            seconds = float(cells.get("seconds", "nan"))
        except (KeyError, ValueError):
            raise CorruptInputError(
                path, f"line {line}: expected a name and numbers, found {','.join(row)}"
            ) from None
        usable = np.isfinite([wavelength, bandwidth, power, sigma]).all() and not np.isinf(seconds)
        if not (usable and min(wavelength, bandwidth, power) > 0.0 and sigma >= 0.0):
            raise CorruptInputError(
                path, f"line {line}: expected a wavelength, a bandwidth and a power above 0"
            )
        if "seconds" in head and not seconds > 0.0:
            raise CorruptInputError(path, f"line {line}: expected seconds above 0")
        found.append((cells["photograph"], wavelength, bandwidth, power, sigma, seconds))
    if not found:
        raise CorruptInputError(path, "names no photograph")
    return found


def _paths(folder: Path, series: Path, names: Sequence[str]) -> list[Path]:
    there = {path.name: path for path in list_images(folder)}
    if lost := [name for name in names if name not in there]:
        raise ArgumentError(f"{series}: not in {folder}: {few(lost)}")
    if doubled := [name for number, name in enumerate(names) if name in names[:number]]:
        raise ArgumentError(f"{series}: more than one line for {few(doubled)}")
    if unknown := sorted(set(there) - set(names)):
        raise ArgumentError(
            f"{series}: has no line for {few(unknown)}; add it, or move the photograph out of "
            f"{folder}"
        )
    return [there[name] for name in names]


def _seconds(paths: Sequence[Path], given: Floats) -> Floats:
    """Exposure times; all alike where neither the table nor every photograph has them."""
    if np.isfinite(given).all():
        return given
    found = [read_exif(path).exposure_s for path in paths]
    known = [one for one in found if one is not None and one > 0.0]
    if not known:
        return np.ones(len(paths))
    if len(known) < len(paths):
        lost = [path.name for path, one in zip(paths, found, strict=True) if not one]
        raise ArgumentError(
            f"series: {few(lost)} do not say their exposure time (EXIF), others do; add a column "
            "seconds"
        )
    return np.array(known)


def _curve(header: ImageHeader, encoding: str | None) -> Encoding:
    return Encoding(stored_curve(header, encoding), _full(header))


def _full(header: ImageHeader) -> float:
    return float(full_scale(header)) if header.dtype.kind == "u" else 1.0


def _black(
    dark: FrameSource | None, header: ImageHeader, shape: tuple[int, ...], encoding: str | None
) -> NDArray[np.float32] | float:
    if dark is None:
        return 0.0
    bands, rows, columns = shape
    return read_dark(dark, (bands, rows, columns), _curve(header, encoding), None, None)


def _light(
    path: Path, header: ImageHeader, encoding: str | None, black: NDArray[np.float32] | float
) -> Floats:
    """``(band, y, x)`` linear light above black, full scale 1 above it."""
    own, codes = load_image(path)
    if own.dtype != header.dtype:
        raise ArgumentError(
            f"{path}: codes of {own.dtype}, but {header.path.name} has {header.dtype}"
        )
    linear = np.asarray(_curve(header, encoding).decode(codes), dtype=np.float64)
    if linear.shape[1:] != (header.height, header.width):
        raise ArgumentError(
            f"{path}: {linear.shape[2]} x {linear.shape[1]} pixels, but {header.path.name} has "
            f"{header.width} x {header.height}; a series is photographed without moving the camera"
        )
    return (linear - black) / (1.0 - np.asarray(black, dtype=np.float64))


def _area(shape: tuple[int, ...], region: Window) -> Mask:
    top, left, height, width = region
    _, rows, columns = shape
    inside = top >= 0 and left >= 0 and top + height <= rows and left + width <= columns
    if not inside or min(height, width) < 1 or height * width < LEAST:
        raise ArgumentError(
            f"region: expected TOP LEFT HEIGHT WIDTH of {LEAST} pixels or more within {rows} rows "
            f"and {columns} columns, found {' '.join(map(str, region))}"
        )
    lit = np.zeros((rows, columns), dtype=bool)
    lit[top : top + height, left : left + width] = True
    return lit


def _lit(total: Floats, folder: Path) -> Mask:
    """The largest connected part that is half as bright as the brightest, without its rim."""
    import cv2

    smooth = np.asarray(cv2.GaussianBlur(total, (0, 0), 1.0))
    bright = smooth >= LIT * float(np.percentile(smooth, 99.9))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(bright.astype(np.uint8))
    if count < 2 or not smooth.max() > 0.0:
        raise ArgumentError(f"region: no lit area found in {folder}; give it, --region")
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    whole = labels == largest
    inner = np.asarray(cv2.erode(whole.astype(np.uint8), np.ones((3, 3), np.uint8))) > 0
    found = inner if inner.sum() >= LEAST else whole
    if found.sum() < LEAST:
        raise ArgumentError(
            f"region: the lit area in {folder} has {int(found.sum())} pixels, {LEAST} are the "
            "least; give it, --region, or go nearer"
        )
    return np.asarray(found)
