"""Photographs on the pixels of the stack: brackets merged, lens and alignment in one resampling.

The same as ``impasto align`` writes, bit for bit: linear codes of 16 bits or floats, by Lanczos
interpolation [@duchon1979lanczos].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.depth_mesh import Parallax
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.frontal_view import FrontalView, cameras_of
from impasto.io.images import MAX_PIXELS, ImageHeader, open_picture
from impasto.io.session.alignment import Alignment
from impasto.io.session.brackets import FULL, Brackets
from impasto.io.session.linear_codes import (
    Photograph,
    full_scale,
    linear_table,
    read_photograph,
    stored_curve,
)
from impasto.io.sources import Source
from impasto.lens import Lens
from impasto.rectification import Grid, rectified_window

NOTHING = np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class Geometry:
    """How the photographs of a session lie on the pixels of the stack.

    Parameters
    ----------
    lens
        Taken out; None: none.
    alignment
        The plane of the painting in each photograph; None: the pixels of a pinhole camera that
        has the lens's camera matrix.
    encoding
        Tone curve of the photographs; None: 8 bits by their profile, else sRGB; others linear.
    saturation
        Code from which samples are clipped; None: the largest.
    brackets
        Photographs that are merged of several exposures; then all are floats of full scale 1.
        With neither lens nor alignment the pixels stay as they are.
    """

    lens: Lens | None
    alignment: Alignment | None
    encoding: str | None = None
    saturation: float | None = None
    brackets: Brackets | None = None

    @property
    def moves(self) -> bool:
        """Whether photographs are resampled at all."""
        return self.lens is not None or self.alignment is not None

    @property
    def grid(self) -> Grid:
        """The pixels of the stack; 1 mm each where there is no alignment.

        Only where photographs are resampled (:attr:`moves`).
        """
        if self.alignment is not None:
            return self.alignment.grid
        assert self.lens is not None
        return Grid((float(self.lens.size[0]), float(self.lens.size[1])), 1.0)

    @property
    def pitch_mm(self) -> float | None:
        """Width of a pixel, which the alignment knows."""
        return None if self.alignment is None else self.alignment.grid.pixel_mm

    def stored_curve(self, path: Path) -> Encoding:
        """The tone curve of a file as the camera wrote it, with its full scale."""
        with open_picture(path) as picture:
            header = picture.header
        full = 1.0 if header.dtype.kind == "f" else float(full_scale(header))
        return Encoding(stored_curve(header, self.encoding), full)

    def view(self, name: str) -> tuple[FrontalView, tuple[float, float]]:
        """How a photograph shows the plane, and its shift.

        Raises
        ------
        ArgumentError
            The alignment has no photograph of this name.
        """
        if self.alignment is None:
            grid = self.grid
            middle = (grid.columns - 1) / 2, (grid.rows - 1) / 2
            matrix = np.array([[1.0, 0.0, middle[0]], [0.0, -1.0, middle[1]], [0.0, 0.0, 1.0]])
            return FrontalView(matrix, self.lens, (), NOTHING, NOTHING), (0.0, 0.0)
        matrix_of, key = self.alignment.homographies, name.casefold()
        if key not in matrix_of:
            raise ArgumentError(
                f"alignment: {self.alignment.path} has no photograph {name}; align it with the "
                "others by impasto align"
            )
        view = FrontalView(matrix_of[key], self.lens, (), NOTHING, NOTHING)
        return view, self.alignment.shifts[key]

    def cameras(self, names: Sequence[str]) -> NDArray[np.float64] | None:
        """``(n, 3)`` places of the cameras in mm; None if not known."""
        if self.alignment is None:
            return None
        found = [self.alignment.cameras[name.casefold()] for name in names]
        return cameras_of([None if one is None else one.place_mm for one in found])

    def _parallax(self, name: str) -> Parallax | None:
        alignment = self.alignment
        camera = None if alignment is None else alignment.cameras[name.casefold()]
        if alignment is None or alignment.depth is None or camera is None:
            return None
        return Parallax(alignment.depth, camera.place_mm)

    def photograph(
        self, path: Path, layer: str | None = None, max_pixels: int = MAX_PIXELS
    ) -> Photograph:
        """Linear codes of a file as the camera wrote it; a bracket is merged.

        Raises
        ------
        ArgumentError
            It has not the size that the lens was calibrated with.
        """
        if self.brackets is None:
            return self._single(path, layer, max_pixels)
        return self.brackets.read(
            path, lambda one: self._single(one, layer, max_pixels), lambda: self.stored_curve(path)
        )

    def _single(self, path: Path, layer: str | None, max_pixels: int) -> Photograph:
        found = read_photograph(
            path, self.encoding, self.saturation, layer=layer, max_pixels=max_pixels
        )
        size = found.planes.shape[2], found.planes.shape[1]
        if self.lens is not None and size != self.lens.size:
            raise ArgumentError(
                f"{path}: {size[0]} x {size[1]} pixels, but the lens was calibrated with "
                f"{self.lens.size[0]} x {self.lens.size[1]}; use photographs as the camera writes "
                "them"
            )
        return found

    def resampled(
        self,
        planes: NDArray[Any],
        name: str,
        rows: slice,
        columns: slice,
        full: float | None = None,
    ) -> NDArray[Any]:
        """A window of the stack's pixels, from ``(band, y, x)`` as the camera saw it.

        Pixels that it does not show are 0. ``name`` is that of the photograph whose place it has;
        ``full`` the code from which samples are clipped.
        """
        if not self.moves:
            return planes[:, rows, columns]
        view, shift = self.view(name)
        found = rectified_window(
            planes, view, self.grid, rows, columns,
            shift=shift, parallax=self._parallax(name), full=full,
        )  # fmt: skip
        return found.planes

    def open(self, path: Path, layer: str | None = None, max_pixels: int = MAX_PIXELS) -> Resampled:
        """A photograph on the pixels of the stack."""
        return Resampled(self, path, layer, max_pixels)


class Resampled(Source):
    """A photograph on the pixels of the stack; its file is decoded whole, once.

    Attributes
    ----------
    header
        As of a linear file of this size.
    full
        The code from which samples are clipped; None: floats that never are.
    """

    def __init__(self, geometry: Geometry, path: Path, layer: str | None, max_pixels: int) -> None:
        with open_picture(path, layer=layer, max_pixels=max_pixels) as picture:
            self._bands, self._size = picture.shape[0], picture.shape[1:]
            stored = picture.header
        self.full = linear_table(stored, geometry.encoding, geometry.saturation)[1]
        floats = stored.dtype.kind == "f"
        if geometry.brackets is not None and not floats:
            floats, self.full = True, None if self.full is None else self.full / FULL
        dtype = np.float32 if floats else np.uint16
        self._geometry, self._path, self._layer = geometry, path, layer
        self._max_pixels = max_pixels
        size = stored.width, stored.height
        if geometry.moves:
            geometry.view(path.name)  # refused before anything is decoded
            size = geometry.grid.columns, geometry.grid.rows
        self.header: ImageHeader = replace(
            stored, width=size[0], height=size[1], dtype=np.dtype(dtype), curve="linear"
        )
        self._photograph: Photograph | None = None

    @property
    def name(self) -> str:
        """See :class:`~impasto.io.Source`."""
        return str(self._path)

    @property
    def shape(self) -> tuple[int, int, int]:
        """See :class:`~impasto.io.Source`."""
        return self._bands, self.header.height, self.header.width

    @property
    def dtype(self) -> np.dtype[Any]:
        """See :class:`~impasto.io.Source`."""
        return np.dtype(self.header.dtype)

    @property
    def grid(self) -> tuple[int, int]:
        """That of the whole file, which any window needs."""
        return max(self._size[0], self.header.height), max(self._size[1], self.header.width)

    def close(self) -> None:
        """Forget the decoded file."""
        self._photograph = None

    def _decoded(self) -> Photograph:
        if self._photograph is None:
            self._photograph = self._geometry.photograph(self._path, self._layer, self._max_pixels)
        return self._photograph

    def _read(self, top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        seen = self._decoded()
        window = slice(top, bottom), slice(left, right)
        return self._geometry.resampled(seen.planes, self._path.name, *window, full=seen.full)


def check_lens(lens: Lens | None, alignment: Alignment | None, lens_path: Path | None) -> None:
    """Refuse an alignment without the lens that it was made with, or with another.

    Raises
    ------
    ArgumentError
        They do not belong together.
    """
    if alignment is None:
        return
    own = None if lens is None else (lens.model, lens.residual_px)
    if own == alignment.lens:
        return
    if lens is None:
        raise ArgumentError(
            f"alignment: {alignment.path} was made with a lens; name its file as camera.lens"
        )
    made = "without a lens" if alignment.lens is None else "with another lens"
    raise ArgumentError(
        f"alignment: {alignment.path} was made {made}, not with {lens_path}; align the photographs "
        "again with this lens, or correct camera.lens"
    )


def curve_of(encoding: Encoding | str | None) -> str | None:
    """The tone curve for resampling, which cannot be estimated from what it makes.

    Raises
    ------
    ArgumentError
        ``"auto"``.
    """
    if isinstance(encoding, Encoding):
        return encoding.curve
    if encoding is not None and str(encoding).lower() == "auto":
        raise ArgumentError(
            'encoding: "auto" needs the photographs as they are; with a lens, an alignment or '
            'brackets say "srgb", "linear" or a gamma'
        )
    return None if encoding is None else str(encoding)
