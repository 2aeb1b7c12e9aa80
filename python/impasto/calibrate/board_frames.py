"""Photographs of a white board, one for each lamp, as means of blocks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import length_mm, numbers
from impasto.calibrate.photon_transfer import pair_blocks
from impasto.calibrate.smooth_field import Floats, block_centres, block_grid, block_means
from impasto.encoding import Encoding
from impasto.errors import ArgumentError, GeometryError
from impasto.io.images import ImageHeader, list_images, load_image
from impasto.io.lights import LightFile, read_lights
from impasto.io.notes import Notebook, few
from impasto.io.session.frames import frame_paths, read_dark
from impasto.io.session.linear_codes import clipping_code, full_scale, stored_curve
from impasto.io.session.match import match_names
from impasto.lights import Light, PointLight

CLIPPED = 0.001
"""Share of clipped samples from which means are wrong by as much."""
DARKEST = 0.02
"""Share of full scale below which a board tells little."""


@dataclass(frozen=True, eq=False)
class BoardFrames:
    """Photographs of a board.

    Parameters
    ----------
    names
        Of the photographs, in the order of the lights.
    size
        Rows and columns of a photograph.
    light
        For each ``(band, rows, columns)``: means of blocks of linear light above black, full scale
        1, over the reflectance of the board.
    white
        The same over cosine and fall-off: light on a white that faces the lamp at its distance from
        the middle.
    geometry
        ``(rows, columns)`` of each: cosine times fall-off.
    pairs
        ``(band, pair, n)`` signals and variances of blocks of pairs, one of them of dark frames
        where there are two or more; empty without a second folder.
    """

    names: tuple[str, ...]
    size: tuple[int, int]
    light: list[Floats]
    white: list[Floats]
    geometry: list[Floats]
    pairs: tuple[Floats, Floats]


def read_board(
    folder: Path,
    lights: Path,
    *,
    dark: Any,
    reflectance: ArrayLike,
    encoding: str | None,
    saturation: float | None,
    pitch_mm: float | None,
    pairs: str | Path | None = None,
) -> BoardFrames:
    """Read the photographs, one at a time; see :func:`impasto.calibrate.board_strengths`."""
    file = read_lights(lights)
    paths = _paths(folder, file)
    seconds = None if pairs is None else _paths(Path(pairs), file)
    reader: _Reader | None = None
    light, white, geometry = [], [], []
    signals: list[Floats] = []
    variances: list[Floats] = []
    for number, (path, lamp) in enumerate(zip(paths, file.lights, strict=True)):
        header, codes = load_image(path)
        if reader is None:
            reader = _Reader(header, codes.shape, dark, reflectance, encoding, saturation)
        planes = reader.linear(path, header, codes)
        if number == 0:
            pitch = _pitch(file, pitch_mm, codes.shape[2])
        shape = planes.shape[1], planes.shape[2]
        factor = _factor(lamp, shape, pitch, path.name)
        means = np.array([block_means(plane) for plane in planes])
        if (means <= 0.0).any():
            raise ArgumentError(f"board: {path} has parts that are no brighter than the dark frame")
        light.append(means / reader.reflectance[:, None, None])
        white.append(light[-1] / factor)
        geometry.append(factor)
        if seconds is not None:
            other = reader.linear(seconds[number], *load_image(seconds[number]))
            blocks = [pair_blocks(*both) for both in zip(planes, other, strict=True)]
            signals.append(np.array([one[0] for one in blocks]))
            variances.append(np.array([one[1] for one in blocks]))
    assert reader is not None
    if seconds is not None and (frames := reader.dark_pair()) is not None:
        blocks = [pair_blocks(*both) for both in zip(*frames, strict=True)]
        signals.append(np.array([one[0] for one in blocks]))
        variances.append(np.array([one[1] for one in blocks]))
    nothing = np.zeros((0, 0, 0))
    found = nothing, nothing
    if seconds is not None:
        found = np.array(signals).swapaxes(0, 1), np.array(variances).swapaxes(0, 1)
    return BoardFrames(tuple(path.name for path in paths), shape, light, white, geometry, found)


def _paths(folder: Path, file: LightFile) -> list[Path]:
    """The board of each light."""
    if not folder.is_dir():
        raise ArgumentError(f"path: {folder} is not a folder")
    pictures = list_images(folder)
    if not pictures:
        raise ArgumentError(f"path: {folder} holds no photographs of a board")
    if file.names is None:
        if len(pictures) != len(file):
            raise ArgumentError(
                f"board: {len(pictures)} photographs in {folder} for the {len(file)} lights of "
                f"{file.path.name}, which names none; photograph the board once under each lamp"
            )
        return pictures
    matched = match_names(file.names, folder, pictures, file.path, Notebook()).paths
    lost = [name for name, path in zip(file.names, matched, strict=True) if path is None]
    if lost:
        raise ArgumentError(
            f"board: {folder} has no photograph of the board for {few(lost)} of {file.path.name}; "
            "photograph it under this lamp, too, or take the lamp out of the light file"
        )
    return [path for path in matched if path is not None]


class _Reader:
    """From codes to linear light above black; all photographs are of one size and type."""

    def __init__(
        self,
        header: ImageHeader,
        shape: tuple[int, ...],
        dark: Any,
        reflectance: ArrayLike,
        encoding: str | None,
        saturation: float | None,
    ) -> None:
        integer = header.dtype.kind == "u"
        full = float(full_scale(header)) if integer else 1.0
        self._first, self._shape = header, shape
        self._curve = Encoding(stored_curve(header, encoding), full)
        self._clipped = full if integer else np.inf
        if saturation is not None:
            self._clipped = clipping_code(saturation, header)
        bands = shape[0]
        found = numbers(reflectance, "reflectance", "a positive number, or one per band").ravel()
        if len(found) not in {1, bands} or not (found > 0).all():
            raise ArgumentError(
                f"reflectance: expected a positive number, or one for each of {bands} bands, found "
                f"{reflectance!r}"
            )
        self.reflectance = np.broadcast_to(found, (bands,))
        self._dark: NDArray[np.float32] | float = 0.0
        self._dark_paths = [] if dark is None else frame_paths(dark) or []
        if dark is not None:
            whole = (shape[0], shape[1], shape[2])
            self._dark = read_dark(dark, whole, self._curve, None, None)

    def dark_pair(self) -> tuple[Floats, Floats] | None:
        """The first two dark frames, as light; None of fewer."""
        if len(self._dark_paths) < 2:
            return None
        one, other = (self._curve.decode(load_image(path)[1]) for path in self._dark_paths[:2])
        return np.asarray(one - self._dark, np.float64), np.asarray(other - self._dark, np.float64)

    def linear(self, path: Path, header: ImageHeader, codes: NDArray[Any]) -> Floats:
        """``(band, y, x)``, or a refusal that names the photograph."""
        if codes.shape != self._shape or codes.dtype != self._first.dtype:
            raise ArgumentError(
                f"board: {path} has {codes.shape[2]} x {codes.shape[1]} pixels, {codes.shape[0]} "
                f"bands of {codes.dtype}, {self._first.path.name} {self._shape[2]} x "
                f"{self._shape[1]}, {self._shape[0]} of {self._first.dtype}"
            )
        share = (codes >= self._clipped).mean(axis=(1, 2))
        if share.max() > CLIPPED:
            raise ArgumentError(
                f"board: {path} is overexposed: {100 * share.max():.1f} % of band "
                f"{int(share.argmax())} is clipped, and its light is not known; expose the board "
                "for less, and the painting by the same setting"
            )
        light = self._curve.decode(codes).astype(np.float64) - self._dark
        level = float(light.mean())
        if level < DARKEST:
            raise ArgumentError(
                f"board: {path} is dark: {100 * level:.2f} % of full scale above black on the "
                "mean; did the lamp light, and is the board in the picture?"
            )
        return np.asarray(light)


def _pitch(file: LightFile, given: float | None, columns: int) -> float | None:
    if given is not None:
        return length_mm(given, "pitch_mm")
    if file.pitch_mm is not None:
        return file.pitch_mm
    return None if file.width_mm is None else file.width_mm / columns


def _factor(lamp: Light, shape: tuple[int, int], pitch: float | None, name: str) -> Floats:
    """Cosine and fall-off on the blocks, ``(rows, columns)``."""
    rows, columns = block_grid(shape)
    if lamp.direction[2] <= 0.0:
        raise GeometryError(f"lights: the lamp of {name} stands behind the board")
    if not isinstance(lamp, PointLight):
        return np.full((rows, columns), lamp.direction[2])
    if pitch is None:
        raise GeometryError(
            "pitch_mm: positions of lamps need the width of a pixel on the painting in mm"
        )
    x = block_centres(shape[1], columns) * pitch
    y = -block_centres(shape[0], rows) * pitch
    px, py, pz = lamp.position
    square = (px - x[None]) ** 2 + (py - y[:, None]) ** 2 + pz * pz
    return np.asarray((px * px + py * py + pz * pz) * pz / square**1.5)
