"""Codes of known relative light: grey patches of one photograph, or places in several exposures."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.smooth_field import block_grid
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import read_text
from impasto.io.images import ImageHeader, list_images, load_image
from impasto.io.images.exif import read_exif
from impasto.io.session.linear_codes import clipping_code, full_scale

Floats = NDArray[np.float64]

HEADER = ("column", "row", "size", "reflectance")
DARKEST = 0.004
"""Share of full scale above black below which stray light is much of it, and ..."""
ROUNDED = 5.0
"""... codes above black below which rounding is."""
PLACES = 40
"""Places of an exposure series in each band, from dark to bright."""
STOPS = 3
"""EXIF rounds exposure times to names of thirds of a stop ..."""
NAMED = 0.08
"""... by less than this: 1/15 s is 1/16 s."""
RISE = 0.002
"""Share of full scale by which codes must rise with the light."""


@dataclass(frozen=True, eq=False)
class Samples:
    """What a tone curve is fitted to.

    Parameters
    ----------
    source
        The photograph or folder, for messages.
    series
        ``"patches"`` or ``"exposures"``.
    codes, light, group, item
        ``(n,)``: share of full scale, relative light within the group, the group (band, or place in
        a band), and the patch or photograph.
    items
        Names of patches or photographs.
    black
        Code of no light as a share of full scale; None: 0 is black.
    advice, doubt
        What to do where a series is too short, and what may be wrong with an item.
    """

    source: str
    series: str
    codes: Floats
    light: Floats
    group: NDArray[np.intp]
    item: NDArray[np.intp]
    items: tuple[str, ...]
    black: float | None
    advice: str
    doubt: str


def patch_samples(
    photograph: Path, patches: Path, dark: float | None, saturation: float | None
) -> Samples:
    """See :func:`impasto.calibrate.tone_from_patches`."""
    header, codes = load_image(photograph)
    full, clipped = _scale(header, saturation)
    rows = _patches(patches)
    black = _black(dark, full)
    values, names = np.full((len(rows), len(codes)), np.nan), []
    for number, (line, x, y, size, _) in enumerate(rows):
        half = size / 2
        top, left = round(y - half), round(x - half)
        bottom, right = max(round(y + half), top + 1), max(round(x + half), left + 1)
        names.append(f"patch {number + 1} ({patches.name}, line {line})")
        if min(top, left) < 0 or bottom > codes.shape[1] or right > codes.shape[2]:
            raise ArgumentError(
                f"{patches}, line {line}: the patch at column {x:g}, row {y:g} leaves the "
                f"photograph of {codes.shape[2]} x {codes.shape[1]} pixels"
            )
        seen = codes[:, top:bottom, left:right].reshape(len(codes), -1)
        usable = (seen < clipped).all(axis=1) & (seen.max(axis=1) > (black or 0.0) * full)
        values[number, usable] = np.median(seen[usable], axis=1) / full
    light = np.array([row[4] for row in rows])
    _check_patches(values, light, names)
    bright = values > (black or 0.0) + _least(header)
    item, band = np.nonzero(np.isfinite(values) & bright)
    return Samples(
        str(photograph), "patches", values[item, band], light[item],
        _numbered(band), item, tuple(names), black,
        "photograph more patches, from dark to white, below the clipping of the file",
        "is the light even, the reflectance right, a highlight on it?",
    )  # fmt: skip


def exposure_samples(
    folder: Path, times: Sequence[float] | None, dark: float | None, saturation: float | None
) -> Samples:
    """See :func:`impasto.calibrate.tone_from_exposures`."""
    if not folder.is_dir():
        raise ArgumentError(f"path: {folder} is not a folder of exposures")
    paths = list_images(folder)
    exposure = _times(folder, paths, times)
    order = np.argsort(exposure, kind="stable")
    paths, exposure = [paths[i] for i in order.tolist()], exposure[order]
    medians, first = [], None
    for path in paths:
        header, codes = load_image(path)
        first = header if first is None else first
        if codes.shape != (len(codes), first.height, first.width) or header.dtype != first.dtype:
            raise ArgumentError(
                f"path: {path.name} differs in size or type from {first.path.name}; a series is "
                "photographed without moving the camera"
            )
        full, clipped = _scale(header, saturation)
        medians.append(_medians(codes, full, clipped))
    values = np.array(medians)  # (photograph, place)
    black = _black(dark, full)
    floor = (black or 0.0) + _least(header)
    values[values <= floor] = np.nan
    if not np.isfinite(values).any():
        raise ArgumentError(
            f"{folder}: every photograph is clipped or black where it could be read; expose from "
            "nearly white to nearly black"
        )
    _check_exposures(values, exposure, paths)
    kept = np.flatnonzero(np.isfinite(values).sum(axis=0) >= 2)
    kept = _spread(values, kept)
    item, place = np.nonzero(np.isfinite(values[:, kept]))
    return Samples(
        str(folder), "exposures", values[:, kept][item, place], exposure[item],
        _numbered(place), item, tuple(path.name for path in paths), black,
        "add exposures, so that the same places are nearly white in one and dark in another",
        "is its exposure time right, and was the light the same?",
    )  # fmt: skip


def _scale(header: ImageHeader, saturation: float | None) -> tuple[float, float]:
    full = float(full_scale(header)) if header.dtype.kind == "u" else 1.0
    return full, full if saturation is None else clipping_code(saturation, header)


def _least(header: ImageHeader) -> float:
    """Share of full scale above black from which codes are used."""
    rounded = ROUNDED / full_scale(header) if header.dtype.kind == "u" else 0.0
    return max(DARKEST, rounded)


def _black(dark: float | None, full: float) -> float | None:
    if dark is None:
        return None
    if not 0.0 <= dark < full:
        raise ArgumentError(f"dark: expected a code from 0 to below {full:g}, found {dark:g}")
    return dark / full


def _patches(path: Path) -> list[tuple[int, float, float, float, float]]:
    """Line, middle, side and reflectance of each patch."""
    reader = csv.reader(io.StringIO(read_text(path)))
    head = tuple(word.strip().lower() for word in next(reader, []))
    if head != HEADER:
        raise CorruptInputError(
            path, f"line 1: expected {','.join(HEADER)}, found {','.join(head) or 'nothing'}"
        )
    found = []
    for line, row in enumerate(reader, 2):
        if not any(word.strip() for word in row):
            continue
        try:
            x, y, size, light = (float(word) for word in row)
        except ValueError as error:
            raise CorruptInputError(path, f"line {line}: expected four numbers") from error
        if not (np.isfinite([x, y]).all() and size >= 1.0 and 0.0 < light <= 2.0):
            raise CorruptInputError(
                path, f"line {line}: expected a size from 1 pixel on and a reflectance above 0"
            )
        found.append((line, x, y, size, light))
    if not found:
        raise CorruptInputError(path, "names no patch")
    return found


def _check_patches(values: Floats, light: Floats, names: Sequence[str]) -> None:
    """A lighter patch has a higher code, in every band."""
    order = np.argsort(light, kind="stable")
    for band in values.T:
        for one, other in zip(order[:-1].tolist(), order[1:].tolist(), strict=True):
            if light[other] > light[one] and band[other] < band[one] - RISE:
                raise ArgumentError(
                    f"patches: {names[other]} reflects more than {names[one]} but is darker; are "
                    "they exchanged, or is the light uneven?"
                )


def _check_exposures(values: Floats, exposure: Floats, paths: Sequence[Path]) -> None:
    """A longer exposure is brighter."""
    for i in range(len(paths) - 1):
        if exposure[i + 1] <= exposure[i] * 1.01:
            continue
        rise = values[i + 1] - values[i]
        rise = rise[np.isfinite(rise)]
        if len(rise) and float(np.median(rise)) < RISE:
            raise ArgumentError(
                f"times: {paths[i + 1].name} was exposed for longer than {paths[i].name} but is "
                "not brighter; are the times in the order of the names, and aperture, sensitivity "
                "and light the same?"
            )


def _times(folder: Path, paths: Sequence[Path], times: Sequence[float] | None) -> Floats:
    if times is not None:
        found: list[Any] = list(times)
        if len(found) != len(paths):
            raise ArgumentError(f"times: {len(found)} for the {len(paths)} photographs in {folder}")
    else:
        found = [read_exif(path).exposure_s for path in paths]
        lost = [path.name for path, one in zip(paths, found, strict=True) if one is None]
        if lost:
            raise ArgumentError(
                f"times: {lost[0]} does not say its exposure time (EXIF); give them in the order "
                "of the names"
            )
    exposure = np.array(found, dtype=np.float64)
    if not (np.isfinite(exposure) & (exposure > 0.0)).all():
        raise ArgumentError(f"times: expected positive times, found {found}")
    if times is None:
        stops = np.round(STOPS * np.log2(exposure)) / STOPS
        near = np.abs(exposure / 2.0**stops - 1.0) < NAMED
        exposure = np.where(near, 2.0**stops, exposure)
    if len(np.unique(exposure)) < 3:
        raise ArgumentError(
            f"times: {len(np.unique(exposure))} different exposure times in {folder}, three are "
            "the least"
        )
    return exposure


def _medians(codes: NDArray[Any], full: float, clipped: float) -> Floats:
    """Of blocks of all bands, NaN where one pixel is clipped.

    The median's code is the code of the median's light, whatever the curve.
    """
    rows, columns = block_grid((codes.shape[1], codes.shape[2]))
    high, wide = codes.shape[1] // rows, codes.shape[2] // columns
    cut = codes[:, : rows * high, : columns * wide].reshape(len(codes), rows, high, columns, wide)
    parts = cut.transpose(0, 1, 3, 2, 4).reshape(len(codes) * rows * columns, high * wide)
    found = np.median(parts, axis=1) / full
    found[parts.max(axis=1) >= clipped] = np.nan
    return np.asarray(found, dtype=np.float64)


def _spread(values: Floats, places: NDArray[np.intp]) -> NDArray[np.intp]:
    """Places from dark to bright: evenly by the code in the exposures that show them."""
    if len(places) <= 3 * PLACES:
        return places
    level = np.nanmean(values[:, places], axis=0)
    order = places[np.argsort(level, kind="stable")]
    return np.asarray(order[np.linspace(0, len(order) - 1, 3 * PLACES).astype(int)])


def _numbered(values: NDArray[np.intp]) -> NDArray[np.intp]:
    """The same groups, numbered without gaps."""
    return np.asarray(np.unique(values, return_inverse=True)[1], dtype=np.intp)
