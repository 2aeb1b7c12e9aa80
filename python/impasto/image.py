"""A rendered picture: XYZ, linear display light and display codes; it writes itself to files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.html import png
from impasto.colour import Display
from impasto.errors import ArgumentError

CELLS = 2048
"""Cells in the table of the tone curve; the Rust core requires this number."""


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """A picture of a painting.

    Attributes
    ----------
    xyz
        ``(3, y, x)`` float32 tristimulus values for the adapted observer; a white board in light of
        intensity 1 has Y = 1. Not clipped.
    linear
        ``(3, y, x)`` float32 linear display light, scaled by ``exposure``. Not clipped.
    display
        ``(y, x, 3)`` uint8 codes.
    coverage
        ``(y, x)`` float32: the share of the pixel that shows the painting. It is 0 outside the
        painting and where its maps are NaN; the picture shows the scene's background there.
    exposure
        The factor from ``xyz`` to display light.
    clipped
        For each channel, the share of pixels that are too bright for the display.
    outside
        For each channel, the share of pixels whose colour is outside the display's gamut.
    screen
        The display that the codes are made for.
    """

    xyz: NDArray[np.float32]
    linear: NDArray[np.float32]
    display: NDArray[np.uint8]
    coverage: NDArray[np.float32]
    exposure: float
    clipped: dict[str, float]
    outside: dict[str, float]
    screen: Display

    def __repr__(self) -> str:
        height, width = self.coverage.shape
        clipped = 100 * max(self.clipped.values())
        return (
            f"<Image {width} x {height} pixels, exposure {self.exposure:.3g}, "
            f"{clipped:.1f} % clipped>"
        )

    @property
    def valid(self) -> NDArray[np.bool_]:
        """``(y, x)``: whether at least half of the pixel shows the painting."""
        return np.asarray(self.coverage >= 0.5)

    @property
    def white_scale(self) -> float:
        """Another name of ``exposure``."""
        return self.exposure

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

        ``.png``, ``.jpg`` and ``.tif``: 8-, 8- and 16-bit display codes; PNG and TIFF contain an
        ICC profile unless the display is sRGB. ``.exr``: linear light R, G, B and coverage A.

        Raises
        ------
        ArgumentError
            Another suffix; or a JPEG, which is written without a profile, for a display other than
            sRGB.
        """
        from impasto.colour import icc_profile
        from impasto.io import write_exr, write_jpeg, write_png8, write_tiff16

        suffix = checked_suffix(path)
        standard = self.screen.name == "srgb"
        icc = None if standard else icc_profile(self.screen)
        if suffix == ".png":
            write_png8(path, self.display, icc=icc)
        elif suffix in {".jpg", ".jpeg"}:
            if not standard:
                raise ArgumentError(
                    f"path: {path} would have no profile of the display {self.screen.name!r}; "
                    "save .png or .tif"
                )
            write_jpeg(path, self.display)
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
