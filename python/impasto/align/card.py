"""The strength of the lamp in each photograph, from a white card beside the painting.

Where camera and lamp move, no white board can be photographed from every view: a card that lies in
the plane of the painting is in every photograph. Its light over its reflectance, the cosine of the
lamp's angle and the fall-off with the square of the distance [@snel] is the strength of the lamp at
the middle of the painting, in each band.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm, positive
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.frontal_view import FrontalView
from impasto.io.images import open_picture
from impasto.io.session.frames import FrameSource, read_dark
from impasto.io.session.linear_codes import Photograph, full_scale, stored_curve

Floats = NDArray[np.float64]

INNER = 0.7
"""Part of each side of the card that counts: its edges are blurred, and marks are off a little."""
PLACES = 48
"""Places on the card along each side that are looked up."""
BLOCKS = 6
"""Blocks of them along each side, whose means are compared."""
UNEVEN = 0.1
"""Relative deviation of the card's light from the model from which it is no even card."""
FULL = 65535.0


@dataclass(frozen=True)
class Card:
    """A matte white card in the plane of the painting.

    Parameters
    ----------
    middle_mm
        ``(x, y)`` of its middle, from the middle of the painting, x right, y up.
    size_mm
        Width and height; its sides are parallel to those of the painting.
    reflectance
        Alike in all bands.

    Raises
    ------
    ArgumentError
        Sizes or a reflectance that are none.
    """

    middle_mm: tuple[float, float]
    size_mm: tuple[float, float]
    reflectance: float = 1.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.middle_mm).all():
            raise ArgumentError(f"card: expected its middle in mm, found {self.middle_mm}")
        for side in self.size_mm:
            length_mm(side, "card")
        positive(self.reflectance, "card_reflectance", "a reflectance above 0 and up to 1")
        if self.reflectance > 1.0:
            raise ArgumentError(f"card_reflectance: expected up to 1, found {self.reflectance:g}")

    def places(self) -> Floats:
        """``(n, n, 2)`` places of its inner part, mm."""
        steps = INNER * ((np.arange(PLACES) + 0.5) / PLACES - 0.5)
        across, down = (steps * side for side in self.size_mm)
        x, y = self.middle_mm
        return np.stack(np.meshgrid(x + across, y + down), axis=-1)


def black_of(
    dark: FrameSource | None, path: Path, encoding: str | None
) -> NDArray[np.float32] | None:
    """``(band, y, x)`` or ``(band, 1, 1)`` linear, full scale 1: what is no light in photographs.

    Parameters
    ----------
    dark
        Dark frames or a level in codes, as for :func:`impasto.read_stack`; None: none.
    path
        One of the photographs.
    encoding
        Their tone curve; None: as :func:`impasto.read_stack` assumes it.

    Raises
    ------
    ArgumentError
        Frames of another shape.
    """
    if dark is None:
        return None
    with open_picture(path) as picture:
        header, shape = picture.header, picture.shape
    full = 1.0 if header.dtype.kind == "f" else float(full_scale(header))
    return read_dark(dark, shape, Encoding(stored_curve(header, encoding), full), None, None)


def strength(
    photograph: Photograph,
    view: FrontalView,
    card: Card,
    lamp: Floats,
    near: bool,
    dark: NDArray[np.float32] | None,
    name: str,
) -> Floats:
    """The strength of the lamp in each band: light of a white board that faces it, full scale 1.

    Parameters
    ----------
    photograph
        Linear codes.
    view
        The plane of the painting in it.
    card
        Where it lies.
    lamp
        ``(3,)`` position of the lamp in mm where it is ``near``, else the direction to it.
    dark
        From :func:`black_of`.
    name
        Of the photograph, for messages.

    Raises
    ------
    ArgumentError
        The card is not in the picture, clipped, dark or uneven.
    """
    import cv2

    where = card.places()
    pixels = view.pixels(where).astype(np.float32)
    rows, columns = photograph.planes.shape[1:]
    if (pixels < 0).any() or (pixels > (columns - 1, rows - 1)).any():
        raise ArgumentError(
            f"card: {name} does not show all of the card; see to its place, or leave this "
            "photograph out"
        )
    left, top = (int(v) for v in np.floor(pixels.min(axis=(0, 1))))
    right, bottom = (int(v) + 2 for v in np.ceil(pixels.max(axis=(0, 1))))
    part = photograph.planes[:, top:bottom, left:right]
    scale = FULL if part.dtype.kind == "u" else 1.0
    at = pixels - np.array([left, top], np.float32)

    def looked_up(planes: NDArray[np.generic]) -> Floats:
        found = [
            cv2.remap(np.asarray(p, np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR)
            for p in planes
        ]
        return np.asarray(found, np.float64)

    codes = looked_up(part)
    if photograph.full is not None and (codes >= photograph.full).any():
        raise ArgumentError(f"card: is clipped in {name}; expose less")
    light = codes / scale
    if dark is not None:
        light -= dark if dark.shape[1:] == (1, 1) else looked_up(dark[:, top:bottom, left:right])
    relative = light / (card.reflectance * _irradiance(where, lamp, near))
    found = np.asarray(relative.mean(axis=(1, 2)))
    if not (found > 0.0).all():
        raise ArgumentError(f"card: is dark in {name}; see whether the lamp was on")
    # Noise of single samples is no unevenness.
    step = PLACES // BLOCKS
    blocks = relative.reshape(-1, BLOCKS, step, BLOCKS, step).mean(axis=(2, 4))
    uneven = float((blocks.std(axis=(1, 2)) / found).max())
    if uneven > UNEVEN:
        raise ArgumentError(
            f"card: its light varies by {100.0 * uneven:.0f} % in {name}; see to the place of the "
            "card, and whether something shades it"
        )
    return found


def _irradiance(where: Floats, lamp: Floats, near: bool) -> Floats:
    """On the plane, relative to a board that faces the lamp at the middle of the painting."""
    if not near:
        height = float(lamp[2] / np.linalg.norm(lamp))
        if height <= 0.0:
            raise ArgumentError("card: a lamp behind the plane of the painting does not light it")
        return np.full(where.shape[:2], height)
    x, y, z = lamp.tolist()
    if z <= 0.0:
        raise ArgumentError("card: a lamp behind the plane of the painting does not light it")
    distance = np.sqrt((x - where[..., 0]) ** 2 + (y - where[..., 1]) ** 2 + z**2)
    return np.asarray((np.linalg.norm(lamp) / distance) ** 2 * z / distance)
