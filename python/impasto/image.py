"""A rendered picture: XYZ, linear display light and display codes; it writes itself to files."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.calls import thread_count
from impasto._internal.checks import number
from impasto._internal.png import png
from impasto.colour import Display
from impasto.errors import ArgumentError

Output = Literal["display", "light"]
"""What a rendering computes at once."""

CELLS = 2048
"""Cells in the table of the tone curve; the Rust core requires this number."""
CHANNELS = ("red", "green", "blue")


class Shown(NamedTuple):
    """Display codes, and how many pixels of each channel the display cannot show."""

    codes: NDArray[np.uint8]
    below: list[int]
    above: list[int]


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """A picture of a painting.

    Only what is asked for is computed: :func:`impasto.render` makes ``display`` or ``xyz`` (its
    ``output=``), and the others when they are first used. ``display`` and ``linear`` follow from
    ``xyz``. For ``xyz`` of a picture that was made as display codes the painting is lit again: its
    arrays must then be as they were.

    Attributes
    ----------
    coverage
        ``(y, x)`` float32: the share of the pixel that shows the painting. It is 0 outside the
        painting and where its maps are NaN; the picture shows the scene's background there.
    exposure
        The factor from ``xyz`` to display light.
    screen
        The display that the codes are made for.
    light
        XYZ, or what computes it.
    made
        Display codes that were made without XYZ.
    threads
        Of what is computed later; None means every allowed core.
    """

    coverage: NDArray[np.float32]
    exposure: float
    screen: Display
    light: NDArray[np.float32] | Callable[[], NDArray[np.float32]]
    made: Shown | None = None
    threads: int | None = None

    def __repr__(self) -> str:
        height, width = self.coverage.shape
        clipped = 100 * max(self.clipped.values())
        return (
            f"<Image {width} x {height} pixels, exposure {self.exposure:.3g}, "
            f"{clipped:.1f} % clipped>"
        )

    def __getstate__(self) -> dict[str, Any]:
        """To be pickled or copied: with its light, not with the painting."""
        return {**vars(self), "light": self.xyz}

    @cached_property
    def xyz(self) -> NDArray[np.float32]:
        """``(3, y, x)`` float32 tristimulus values for the adapted observer, not clipped.

        A white board in light of intensity 1 has Y = 1.
        """
        return self.light() if callable(self.light) else self.light

    @cached_property
    def linear(self) -> NDArray[np.float32]:
        """``(3, y, x)`` float32 linear display light, scaled by ``exposure``, not clipped."""
        return _core.linear_from_bands(self.xyz, self._matrix, thread_count(self.threads))

    @cached_property
    def _shown(self) -> Shown:
        if self.made is not None:
            return self.made
        curve, workers = tone_curve(self.screen), thread_count(self.threads)
        return Shown(*_core.display_from_bands(self.xyz, self._matrix, curve, 8, workers))

    @property
    def _matrix(self) -> NDArray[np.float64]:
        return columns_to_display(self.screen, self.exposure)

    @property
    def display(self) -> NDArray[np.uint8]:
        """``(y, x, 3)`` uint8 codes."""
        return self._shown.codes

    @property
    def clipped(self) -> dict[str, float]:
        """For each channel, the share of pixels that are too bright for the display."""
        return self._shares(self._shown.above)

    @property
    def outside(self) -> dict[str, float]:
        """For each channel, the share of pixels whose colour is outside the display's gamut."""
        return self._shares(self._shown.below)

    def _shares(self, counts: list[int]) -> dict[str, float]:
        pixels = self.coverage.size
        return {name: count / pixels for name, count in zip(CHANNELS, counts, strict=True)}

    @property
    def valid(self) -> NDArray[np.bool_]:
        """``(y, x)``: whether at least half of the pixel shows the painting."""
        return np.asarray(self.coverage >= 0.5)

    @property
    def white_scale(self) -> float:
        """Another name of ``exposure``."""
        return self.exposure

    def resampled(self, share: float) -> Image:
        """The picture with so many times its rows and columns: light is averaged over areas.

        Parameters
        ----------
        share
            Above 0, at most 1. Rows and columns are rounded, to at least 1.

        Raises
        ------
        ArgumentError
            Another number.
        """
        import cv2

        if not 0.0 < number(share, "share", "a number above 0, at most 1") <= 1.0:
            raise ArgumentError(f"share: expected a number above 0, at most 1, found {share!r}")
        rows, columns = (max(1, round(share * size)) for size in self.coverage.shape)

        def small(plane: NDArray[np.float32]) -> NDArray[np.float32]:
            found = cv2.resize(plane, (columns, rows), interpolation=cv2.INTER_AREA)
            return np.asarray(found, dtype=np.float32)

        planes = np.stack([small(plane) for plane in self.xyz])
        return Image(small(self.coverage), self.exposure, self.screen, planes, threads=self.threads)

    def report(self) -> dict[str, Any]:
        """Numbers for a report file."""
        return {
            "exposure": self.exposure,
            "clipped": dict(self.clipped),
            "outside_gamut": dict(self.outside),
            "covered": float(self.coverage.mean(dtype=np.float64)),
            "display": self.screen.name,
        }

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """``np.asarray(image)``: the display codes ``(y, x, 3)``."""
        return np.array(self.display, dtype=dtype, copy=copy)

    def _repr_png_(self) -> bytes:
        """PNG for notebooks."""
        return png(self.display)

    def save(self, path: str | Path) -> None:
        """Write the picture; the suffix selects the format.

        ``.png``, ``.jpg`` and ``.tif``: 8-, 8- and 16-bit display codes with the ICC profile of
        their display, sRGB included. ``.exr``: linear light R, G, B and coverage A.

        Raises
        ------
        ArgumentError
            Another suffix.
        """
        from impasto.colour import icc_profile
        from impasto.io import write_exr, write_jpeg, write_png8, write_tiff16

        suffix = checked_suffix(path)
        icc = icc_profile(self.screen)
        if suffix == ".png":
            write_png8(path, np.moveaxis(self.display, -1, 0), icc=icc)
        elif suffix in {".jpg", ".jpeg"}:
            write_jpeg(path, np.moveaxis(self.display, -1, 0), icc=icc)
        elif suffix in {".tif", ".tiff"}:
            write_tiff16(path, self.screen.encode(self.linear), icc=icc)
        else:
            write_exr(path, dict(zip("RGBA", (*self.linear, self.coverage), strict=True)))


def checked_suffix(path: str | Path, name: str = "path") -> str:
    """The suffix of a picture file, in lower case.

    Raises
    ------
    ArgumentError
        A suffix that :meth:`Image.save` does not support.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr"}:
        raise ArgumentError(
            f"{name}: expected a name ending in .png, .jpg, .tif or .exr, found {path}"
        )
    return suffix


def tone_table(display: Display) -> NDArray[np.float32]:
    """The tone curve at equal steps of the square root of light, ``(3, 2049)``."""
    light = np.linspace(0.0, 1.0, CELLS + 1) ** 2
    return np.ascontiguousarray(
        display.encode(np.broadcast_to(light, (3, light.size))), dtype=np.float32
    )


_CURVES: dict[int, tuple[weakref.ref[Display], _core.ToneCurve]] = {}
"""What :func:`tone_curve` has made of displays that are still there, by their identity."""


def tone_curve(display: Display) -> _core.ToneCurve:
    """The tone curve of a display as the core takes it, made once for each display."""
    key = id(display)
    kept = _CURVES.get(key)
    if kept is not None and kept[0]() is display:
        return kept[1]
    curve = _core.ToneCurve(tone_table(display))
    _CURVES[key] = weakref.ref(display, lambda _: _CURVES.pop(key, None)), curve
    return curve


def columns_to_display(display: Display, exposure: float) -> NDArray[np.float64]:
    """``(3, 3)`` columns of the matrix from XYZ to linear display light."""
    return np.ascontiguousarray((exposure * display.linear_from_xyz).T)


def exposure_of_maximum(xyz: NDArray[np.float32], coverage: NDArray[np.float32]) -> float:
    """The factor at which the largest Y of the picture is that of the display's white."""
    luminance = xyz[1][coverage > 0.0]
    highest = float(luminance.max(initial=0.0))
    return 1.0 / highest if highest > 0.0 else 1.0
