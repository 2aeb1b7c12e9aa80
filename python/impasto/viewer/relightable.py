"""A relightable image of another program (.ptm, .rti, relight's folders) as the page shows it.

A picture is a sum of planes, weighted by functions of the light's direction. The page gets the
planes as they are stored and the functions as numbers, and evaluates them itself
(``page/basis.js``).
"""

from __future__ import annotations

import gzip
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.io.rti import RelightableImage
from impasto.rig import FRONTAL
from impasto.viewer.colours import colours_of
from impasto.viewer.layout import COMPRESSION, SHOWN, UNREAD, Group, Layout
from impasto.viewer.scales import SIDE, Scale, eye_of

COLOUR = ("red", "green", "blue")
"""Planes of the colour by which a luminance is multiplied."""


@dataclass(frozen=True, eq=False)
class RelightablePainting:
    """Planes whose weighted sum is the picture.

    Smaller scales hold means of 2 x 2 codes. The sum of means is the mean of the sums; where a
    luminance is multiplied by a colour (``lrgb``), this holds where the colour is constant.

    Attributes
    ----------
    image
        What was read.
    """

    image: RelightableImage
    pitch_mm: float | None = field(init=False)
    shown_bands: int | None = field(init=False, default=3)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pitch_mm", self.image.pitch_mm)

    @cached_property
    def _levels(self) -> list[NDArray[Any]]:
        """``(plane, y, x)`` codes at each scale."""
        image = self.image
        codes = (
            image.planes if image.colour is None else np.concatenate([image.planes, image.colour])
        )
        found: list[NDArray[Any]] = [codes]
        while max(found[-1].shape[1:]) > SIDE and min(found[-1].shape[1:]) > 1:
            found.append(_halved(found[-1]))
        return found

    @property
    def scales(self) -> tuple[Scale, ...]:
        """From the image itself to the smallest."""
        return tuple(
            Scale(2**number, (one.shape[1], one.shape[2]))
            for number, one in enumerate(self._levels)
        )

    @property
    def layout(self) -> Layout:
        """How its planes lie in tiles."""
        names = [f"code{number}" for number in range(len(self.image.planes))]
        if self.image.colour is not None:
            names += COLOUR
        return Layout((Group("int16", ("flags",)), Group("half", tuple(names))))

    def facts(self) -> dict[str, Any]:
        """Its entries of the document."""
        return {
            "groups": self.layout.record(),
            "model": "relightable",
            "basis": _basis(self.image),
            "lobes": [],
            "index": 1.5,
            "coated": False,
            "ambient": False,
            "beneath": False,
            "quality": [],
            "relief": False,
            "coefficients": 3,
            "bands": list(COLOUR),
            "origin": [0.0, 0.0],
            "eye": eye_of(FRONTAL),
            "colours": colours_of(None, 3),
        }

    def effects(self) -> list[dict[str, str]]:
        """None: what it holds cannot be taken apart."""
        return []

    def known(self, scale: Scale, part: Window) -> bool:
        """True: every pixel has its codes."""
        return True

    def tiles(self, scale: Scale, parts: Sequence[Window]) -> Iterator[bytes]:
        """Parts as the page reads them."""
        return (self._tile(scale, part) for part in parts)

    def _tile(self, scale: Scale, part: Window) -> bytes:
        codes = self._levels[scale.factor.bit_length() - 1][:, *part]
        planes: dict[str, NDArray[Any]] = dict(
            zip(self.layout.groups[1].planes, codes, strict=True)
        )
        shown = np.ones(codes.shape[1:], bool)
        planes["flags"] = np.full(shown.shape, SHOWN + UNREAD, np.int16)
        return gzip.compress(self.layout.texels(planes, shown), COMPRESSION, mtime=0)


def _halved(codes: NDArray[Any]) -> NDArray[np.float32]:
    """Means of 2 x 2 codes."""
    rows, columns = (size // 2 for size in codes.shape[1:])
    whole = codes[:, : 2 * rows, : 2 * columns].reshape(len(codes), rows, 2, columns, 2)
    return np.asarray(whole.mean(axis=(2, 4), dtype=np.float32))


def _basis(image: RelightableImage) -> dict[str, Any]:
    """The functions and what turns codes into coefficients, for the page."""
    basis = image.basis
    found: dict[str, Any] = {
        "kind": basis.kind,
        "terms": basis.terms,
        "format": image.format,
        "colourspace": image.colourspace,
        "coding": image.coding,
        "notes": list(image.notes),
        "scale": [float(value) for value in image.scale],
        "bias": [float(value) for value in image.bias],
    }
    if basis.lights is not None:
        found |= {"lights": basis.lights.tolist(), "sigma": float(basis.sigma)}
    if image.components is not None:
        # Single precision has 7 digits, and a code of the picture needs 3.
        found["components"] = [
            [[float(f"{value:.8g}") for value in term] for term in plane]
            for plane in image.components
        ]
    return found
