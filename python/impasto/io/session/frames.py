"""From coded values to linear light: tone curve, dark frame, white board, light strength."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import list_images, open_picture
from impasto.io.notes import Notebook
from impasto.io.session.geometry import Geometry
from impasto.io.session.match import match_names
from impasto.io.sources import Source
from impasto.lights import PointLight
from impasto.rig import Rig

Region: TypeAlias = tuple[int, int, int, int]
FrameSource: TypeAlias = "str | Path | Sequence[str | Path] | ArrayLike"


def crop(planes: NDArray[Any], region: Region | None) -> NDArray[Any]:
    """``(top, left, height, width)`` of the last two axes."""
    if region is None:
        return planes
    top, left, height, width = region
    return planes[..., top : top + height, left : left + width]


def read_region(source: Source, region: Region | None) -> NDArray[Any]:
    """As :func:`crop` of the whole; only what the region touches is decoded."""
    if region is None:
        return source.read()
    top, left, height, width = region
    return source.read(slice(top, top + height), slice(left, left + width))


def read_region_into(source: Source, region: Region | None, out: NDArray[Any]) -> None:
    """As :func:`read_region`, written to where the samples are wanted."""
    rows = columns = None
    if region is not None:
        top, left, height, width = region
        rows, columns = slice(top, top + height), slice(left, left + width)
    source.read_into(out, rows, columns)


def picture_codes(path: Path, layer: str | None, region: Region | None) -> NDArray[Any]:
    """The codes of a picture, or of as much of the region as it has."""
    with open_picture(path, layer=layer) as picture:
        _, rows, columns = picture.shape
        if region is not None and (region[0] + region[2] > rows or region[1] + region[3] > columns):
            return crop(picture.read(), region)
        return read_region(picture, region)


def check_region(region: Sequence[int] | None, shape: tuple[int, int]) -> Region | None:
    """The region as four integers that lie inside the picture."""
    if region is None:
        return None
    if len(region) != 4:
        raise ArgumentError(f"region: expected (top, left, height, width), found {region}")
    top, left, height, width = (int(v) for v in region)
    if not (0 <= top < top + height <= shape[0] and 0 <= left < left + width <= shape[1]):
        raise ArgumentError(
            f"region: {(top, left, height, width)} does not lie inside a picture of {shape[0]} "
            f"rows and {shape[1]} columns"
        )
    return top, left, height, width


@dataclass(frozen=True, eq=False)
class Calibration:
    """How the codes of one observation become linear light relative to the white board.

    Eq. 3 of the RGB-camera paper: I' = (I - dark) cos(theta_w) R / (W - dark), with W the board
    in the painting's plane under the same light, theta_w its angle of incidence and R its
    reflectance.

    Parameters
    ----------
    encoding
        The tone curve of photographs, board and dark frames.
    saturation
        ``(band,)`` code from which a sample is clipped, or None.
    dark
        ``(band, y, x)`` linear, or None.
    board
        For each observation the board's file (codes), one array for all, or None.
    board_exposure
        ``(obs,)`` exposure of each photograph over that of its board, or None: the same.
    gains
        ``(obs, band)`` strength of each light in each band, or None.
    geometry
        What photographs were resampled by; board and dark frames, as the camera saw them, are
        resampled alike.
    photographs
        The file name of each observation, for the geometry.
    """

    encoding: Encoding
    saturation: NDArray[np.float64] | None
    dark: NDArray[np.float32] | None = None
    board: Sequence[Path] | NDArray[Any] | None = None
    board_reflectance: NDArray[np.float64] | None = None
    board_exposure: NDArray[np.float64] | None = None
    rig: Rig | None = None
    gains: NDArray[np.float64] | None = None
    region: Region | None = None
    layer: str | None = None
    geometry: Geometry | None = None
    photographs: Sequence[str] = ()

    @property
    def changes(self) -> bool:
        """Whether anything besides the tone curve is applied."""
        return self.dark is not None or self.board is not None or self.gains is not None

    @property
    def only_level(self) -> bool:
        """Whether a black level, the same at every pixel, is all there is to apply."""
        level = self.dark is not None and self.dark.shape[1:] == (1, 1)
        return (
            level and self.board is None and self.gains is None and self.encoding.curve == "linear"
        )

    def linear(self, codes: NDArray[Any]) -> NDArray[np.float32]:
        """The tone curve alone, any shape."""
        if codes.dtype.kind == "u":
            every = np.arange(np.iinfo(codes.dtype).max + 1, dtype=np.float32)
            return np.asarray(self.encoding.decode(every)[codes], dtype=np.float32)
        return self.encoding.decode(codes)

    def apply(self, codes: NDArray[Any], index: int) -> NDArray[np.float32]:
        """One observation ``(band, y, x)``; with frames, clipped samples become +inf."""
        value = self.linear(codes)
        if not self.changes:
            return value
        if self.dark is not None:
            value = value - self._dark(index, value.shape)
        if self.board is not None:
            value = value * self._flat(index, value.shape)
            if self.board_exposure is not None:
                value = value / np.float32(self.board_exposure[index])
        if self.gains is not None:
            value = value / self.gains[index][:, None, None].astype(np.float32)
        if self.saturation is not None:
            value[codes >= self.saturation[:, None, None]] = np.inf
        return np.asarray(value, dtype=np.float32)

    def _dark(self, index: int, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """On the pixels of an observation."""
        assert self.dark is not None
        if self.geometry is None or self.dark.shape[1:] == (1, 1):
            return self.dark
        return self._resampled(self.dark, index, shape)

    def _resampled(
        self, planes: NDArray[Any], index: int, shape: tuple[int, ...], full: float | None = None
    ) -> NDArray[Any]:
        assert self.geometry is not None
        top, left, height, width = self.region or (0, 0, *shape[1:])
        window = slice(top, top + height), slice(left, left + width)
        return self.geometry.resampled(planes, self.photographs[index], *window, full=full)

    def stored_saturation(self) -> NDArray[np.float64] | None:
        """The saturation level in the units of :meth:`apply`'s result."""
        if self.changes or self.saturation is None:
            return None
        return self.encoding.decode(self.saturation).astype(np.float64)

    def _flat(self, index: int, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """cos(theta_w) R / (W - dark); NaN where the board is clipped or dark."""
        cosine: NDArray[np.float32] | float = 1.0
        if isinstance(self.board, np.ndarray):
            codes = self.board[index] if self.board.ndim == 4 else self.board
            one_for_all = self.board.ndim == 3
        else:
            assert self.board is not None
            one_for_all = len(self.board) == 1
            path = self.board[0 if one_for_all else index]
            if self.geometry is None:
                codes = picture_codes(path, self.layer, self.region)
            else:
                seen = self.geometry.photograph(path, self.layer)
                codes = self._resampled(seen.planes, index, shape, seen.full)
            if codes.shape != shape:
                raise ArgumentError(
                    f"white: {path} has shape {codes.shape} (band, y, x), the photographs {shape}"
                )
        if not one_for_all and self.rig is not None:
            cosine = board_cosine(self.rig, index, (shape[1], shape[2]))
        board = self.linear(codes)
        if self.dark is not None:
            board = board - self._dark(index, shape)
        unknown = ~(board > 0)
        if self.saturation is not None:
            unknown |= codes >= self.saturation[:, None, None]
        reflectance = (
            1.0 if self.board_reflectance is None else self.board_reflectance[:, None, None]
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = np.asarray(cosine * reflectance / board, dtype=np.float32)
        flat[unknown] = np.nan
        return flat


def board_cosine(rig: Rig, index: int, shape: tuple[int, int]) -> NDArray[np.float32] | float:
    """cos(theta_w) on a board in the painting's plane: one number, or ``(y, x)`` near a light."""
    light = rig.lights[index]
    if not isinstance(light, PointLight):
        return light.direction[2]
    height, width = shape
    pitch = float(rig.pitch_mm or 1.0)
    x = (np.arange(width) - (width - 1) / 2) * pitch
    y = ((height - 1) / 2 - np.arange(height)) * pitch
    px, py, pz = light.position
    distance = np.sqrt((px - x[None, :]) ** 2 + (py - y[:, None]) ** 2 + pz**2)
    return np.asarray(pz / distance, dtype=np.float32)


def resampled_dark(
    dark: FrameSource, geometry: Geometry, bands: int, curve: Encoding, layer: str | None
) -> NDArray[np.float32]:
    """As :func:`read_dark`, ``(band, y, x)`` as the camera saw it.

    ``curve`` is that of the files, of which a level is a code.
    """
    paths = frame_paths(dark)
    if paths is None:
        if np.ndim(np.asarray(dark)) > 1:
            raise ArgumentError(
                "dark: with a lens, an alignment or brackets, dark frames are files; found an array"
            )
        return read_dark(dark, (bands, 1, 1), curve, None, layer)
    total = np.zeros((1, 1, 1))
    for path in paths:
        planes = geometry.photograph(path, layer).planes
        if len(planes) != bands:
            raise ArgumentError(f"dark: {path} has {len(planes)} bands, the photographs {bands}")
        scale = 1.0 if planes.dtype.kind == "f" else 1.0 / 65535.0
        total = total + planes * scale
    return _checked_dark((total / len(paths)).astype(np.float32), curve)


def read_dark(
    dark: FrameSource,
    shape: tuple[int, int, int],
    encoding: Encoding,
    region: Region | None,
    layer: str | None,
) -> NDArray[np.float32]:
    """The mean of one or more dark frames, linear, ``(band, y, x)`` or ``(band, 1, 1)``.

    Accepts a picture, a folder or list of pictures (averaged), or an array of codes: one number,
    one per band, ``(y, x)``, ``(band, y, x)`` or ``(frame, band, y, x)``.
    """
    paths = frame_paths(dark)
    if paths is not None:
        total = np.zeros(shape, dtype=np.float64)
        for path in paths:
            codes = picture_codes(path, layer, region)
            if codes.shape != shape:
                raise ArgumentError(
                    f"dark: {path} has shape {codes.shape} (band, y, x), the photographs {shape}"
                )
            total += encoding.decode(codes)
        return _checked_dark((total / len(paths)).astype(np.float32), encoding)
    array = np.asarray(dark)
    if array.dtype.kind not in "fiu" or array.size == 0:
        raise ArgumentError(f"dark: expected codes or pictures, found {dark!r}")
    if array.ndim == 4:
        linear = encoding.decode(array).mean(axis=0, dtype=np.float64)
    else:
        linear = encoding.decode(array.reshape(-1, 1, 1) if array.ndim < 2 else array)
    if linear.ndim == 2:
        linear = linear[None]
    if linear.shape[1:] not in {(1, 1), shape[1:]}:
        linear = crop(linear, region)
    if linear.shape[0] not in {1, shape[0]} or linear.shape[1:] not in {(1, 1), shape[1:]}:
        raise ArgumentError(
            f"dark: shape {array.shape} does not fit photographs of shape {shape} (band, y, x)"
        )
    linear = np.broadcast_to(linear, (shape[0], *linear.shape[1:]))
    stated = array.reshape(-1).tolist() if array.ndim < 2 else None
    return _checked_dark(np.ascontiguousarray(linear, np.float32), encoding, stated)


def _checked_dark(
    linear: NDArray[np.float32], encoding: Encoding, stated: Sequence[float] | None = None
) -> NDArray[np.float32]:
    """A dark level is finite and below full scale; a frame may have bad pixels, not only bad ones.

    What the pixels of floating-point pictures can reach at most is not known (``white`` 1.0).
    ``stated`` are the codes of levels, one or one per band, as they were given.
    """
    usable: NDArray[np.bool_] = np.isfinite(linear)
    if encoding.white != 1.0:
        usable &= linear < 1.0
    for band, some in enumerate(usable.reshape(len(usable), -1)):
        if not some.any():
            level = encoding.white * float(linear[band].flat[0])
            if stated is not None:
                level = stated[band % len(stated)]
            raise ArgumentError(
                f"dark: expected finite codes below full scale ({encoding.white:g}), band {band} "
                f"holds none (such as {level:g})"
            )
    return linear


def find_board(
    white: FrameSource,
    names: Sequence[str],
    shape: tuple[int, int, int],
    region: Region | None,
    source: Path,
    notebook: Notebook,
) -> Sequence[Path] | NDArray[Any]:
    """One board frame per observation, or one for all.

    Accepts a picture (one for all), a folder or ``.lp`` whose pictures have the photographs' names
    or the same number and order, a list of pictures, or codes ``(band, y, x)`` or
    ``(obs, band, y, x)``.
    """
    paths = frame_paths(white)
    if paths is None:
        array = np.asarray(white)
        if array.ndim in {3, 4} and array.shape[-2:] != shape[1:]:
            array = crop(array, region)
        if array.shape not in {shape, (len(names), *shape)}:
            raise ArgumentError(
                f"white: expected shape {shape} or {(len(names), *shape)}, found {array.shape}"
            )
        return array
    if len(paths) == 1:
        notebook.say(
            "white",
            paths[0],
            "one board frame for all lights: it corrects vignetting and colour, but not "
            "differences between the lights",
        )
        return paths
    if isinstance(white, str | Path) and Path(white).is_dir():
        matched = match_names(names, Path(white), paths, source, notebook).paths
        lost = [name for name, path in zip(names, matched, strict=True) if path is None]
        if lost:
            raise ArgumentError(f"white: {white} has no board frame for {lost[0]!r}")
        return [path for path in matched if path is not None]
    if len(paths) != len(names):
        raise ArgumentError(f"white: {len(paths)} board frames for {len(names)} photographs")
    return paths


def frame_paths(source: FrameSource) -> list[Path] | None:
    """The pictures that a frame option names, or None if it is an array."""
    if isinstance(source, str | Path):
        path = Path(source)
        if path.is_dir():
            found = list_images(path)
            if not found:
                raise ArgumentError(f"{path}: the folder holds no pictures")
            return found
        return [path]
    if isinstance(source, Sequence) and source and isinstance(source[0], str | Path):
        return [Path(str(path)) for path in source]
    return None
