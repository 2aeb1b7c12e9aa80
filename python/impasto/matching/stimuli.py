"""Pictures of a painting for several degrees of adaptation, of one brightness of white."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import instance
from impasto.colour import Display, white_point, xyz_from_coefficients
from impasto.colour.adaptation import Mode
from impasto.colour.temperature import checked_degree
from impasto.errors import ArgumentError
from impasto.fit.reflectance import Reflectance
from impasto.fit.result import Sbrdf
from impasto.render import render
from impasto.scene import Scene
from impasto.status import Status

DEGREES = tuple(round(0.1 * number, 1) for number in range(11))
"""Degrees of the pictures, if nobody says otherwise."""
PAPER_LIGHT = (0.0, 0.71, 0.71)
"""Where the lamp stands, as in the pictures of the paper: above, at 45 degrees, so that a painting
that is seen from the front shows no strong highlight."""
PATCHES = 64
"""Colours of the painting that a log keeps, for comparison with models of adaptation."""


@dataclass(frozen=True, eq=False)
class Stimuli:
    """What observers choose among.

    Attributes
    ----------
    degrees
        Of each picture, rising.
    pictures
        ``(y, x, 3)`` uint8 display codes, in the order of the degrees.
    xyz
        ``(3, n)`` colours of places of the painting under the lamp, not adapted, white at Y = 1.
    illuminant, reference, mode, display
        As in :class:`impasto.Scene`; lights and display by name.
    exposure
        The factor on all light: the same in all pictures, so that white is equally bright.
    """

    degrees: tuple[float, ...]
    pictures: tuple[NDArray[np.uint8], ...]
    xyz: NDArray[np.float64]
    illuminant: str | float
    reference: str | float
    mode: Mode
    display: str
    exposure: float

    @property
    def key(self) -> str:
        """CRC-32 of pictures and degrees: sessions of one key showed the same."""
        found = zlib.crc32(repr(self.degrees).encode())
        for picture in self.pictures:
            found = zlib.crc32(picture.tobytes(), found)
        return f"{found:08x}"


def stimuli(
    sbrdf: Sbrdf,
    reflectance: Reflectance,
    degrees: Sequence[float] = DEGREES,
    *,
    light: ArrayLike = PAPER_LIGHT,
    illuminant: str | float = "A",
    reference: str | float = "D65",
    mode: Mode = "planck",
    display: Display | str = "srgb",
    reduce: int = 1,
) -> Stimuli:
    """Render a painting for all degrees.

    Parameters
    ----------
    sbrdf, reflectance
        A fitted painting with its spectra.
    degrees
        Of adaptation, 0 to 1; two or more, all different. Default: 0 to 1 in steps of 0.1.
    light
        Direction to the lamp; default: that of the paper.
    illuminant
        Light of the lamp beside which observers look at the painting: a name or kelvin.
    reference, mode, display
        As in :class:`impasto.Scene`.
    reduce
        How many pixels of the painting, along a side, become one of the pictures.

    Raises
    ------
    ArgumentError
        Degrees that are none, and what :func:`impasto.render` refuses.
    """
    instance(sbrdf, Sbrdf, "sbrdf", "a result of impasto.fit_sbrdf")
    instance(reflectance, Reflectance, "reflectance", "a result of impasto.fit_reflectance")
    rising = tuple(sorted(checked_degree(d) for d in degrees))
    if len(rising) < 2 or len(set(rising)) < len(rising):
        raise ArgumentError(f"degrees: expected two or more different ones, found {rising}")

    towards = np.asarray(light, np.float64)[None]

    def shown(part: Sbrdf, spectra: Reflectance, d: float, exposure: float | None) -> Any:
        scene = Scene(
            towards, illuminant=illuminant, adaptation=d, adaptation_mode=mode,
            reference=reference, display=display, exposure=exposure,
        )  # fmt: skip
        return render(part, scene, reflectance=spectra, reduce=reduce if exposure else 1)

    corner = sbrdf[:1, :1], reflectance[:1, :1]
    exposure = min(float(shown(*corner, d, None).exposure) for d in rising)
    pictures = tuple(shown(sbrdf, reflectance, d, exposure).display for d in rising)
    fold = xyz_from_coefficients(reflectance.basis, reflectance.wavelengths, illuminant)
    known = np.flatnonzero((reflectance.status < Status.DARK).ravel())
    if not known.size:
        raise ArgumentError("reflectance: no pixel was estimated")
    every = known[np.linspace(0, known.size - 1, min(PATCHES, known.size)).astype(int)]
    flat = reflectance.coefficients.reshape(len(reflectance.basis), -1)[:, every]
    name = display if isinstance(display, str) else display.name
    return Stimuli(
        degrees=rising,
        pictures=pictures,
        xyz=np.maximum(fold.diffuse @ flat.astype(np.float64), 0.0) / white_point(illuminant)[1],
        illuminant=illuminant,
        reference=reference,
        mode=mode,
        display=name,
        exposure=exposure,
    )
