"""The pictures that USD and MaterialX scenes name: colour, roughness, highlight and normals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.export.loss import Shown
from impasto.export.shading import Angles, ggx
from impasto.export.source import Direction, Map, Source
from impasto.export.textures import (
    coded_linear,
    coded_normals,
    coded_srgb,
    decoded_normals,
    decoded_srgb,
    textures,
)
from impasto.io.images.read import read_image
from impasto.io.images.write import write_png8, write_png16

FOLDER = "textures"
COLOUR, SHINE, ROUGHNESS, NORMAL = "colour.png", "specular.png", "roughness.png", "normal.png"
LOST = (
    "all but one lobe of a pixel, and its shape: facets of GGX have a wider foot",
    "ambient light, which stands in the diffuse colour, the same for all lights",
    "shadows, interreflections and what photographs show besides the model",
    "spectra, illuminants and adaptation: colours are those under D65",
    "reflectance head-on above 1, and colours beyond sRGB",
)
KEPT = (
    "normals of 16 bits; diffuse colour, highlight and roughness of 8 bits",
    "the painting's size",
)


@dataclass(frozen=True)
class Written:
    """What the scene must say about the pictures.

    Attributes
    ----------
    strongest
        Reflectance head-on of the strongest highlight: ``specular.png`` is relative to it where
        ``relative``.
    """

    strongest: float


def write_textures(source: Source, folder: Path, *, relative: bool) -> Written:
    """Write the pictures into ``textures/`` of a folder.

    ``relative``: whether ``specular.png`` is a share of the strongest highlight, or the reflectance
    itself.
    """
    maps = textures(source, "ggx")
    head_on = maps.head_on
    # A dielectric that reflects all light has no index of refraction.
    strongest = float(np.clip(head_on.max(initial=0.0), 0.02, 0.95))
    through = np.maximum(1.0 - head_on.max(axis=0), 1e-3)
    target = folder / FOLDER
    target.mkdir()
    write_png8(target / COLOUR, coded_srgb(maps.diffuse / through))
    write_png8(target / SHINE, coded_srgb(head_on / strongest if relative else head_on))
    write_png8(target / ROUGHNESS, coded_linear(np.sqrt(maps.lobe.alpha)))
    write_png16(target / NORMAL, coded_normals(maps.normal, 16))
    return Written(strongest)


def shown_by(folder: Path, strongest: float | None) -> Shown:
    """What the pictures show; ``strongest`` where highlights are a share of it, else None."""
    colour, shine, rough, normal = (
        (found := read_image(folder / FOLDER / name)).reshape(len(found), -1)
        for name in (COLOUR, SHINE, ROUGHNESS, NORMAL)
    )

    def shown(light: Direction, view: Direction | None, at: NDArray[np.intp]) -> Map:
        alpha = np.square(rough[0, at].astype(np.float32) / np.float32(255.0))
        angles = Angles.of(decoded_normals(normal[:, at]), light, view)
        share = decoded_srgb(shine[:, at])
        if strongest is None:
            return ggx(decoded_srgb(colour[:, at]), share, alpha, angles)
        weight = share.max(axis=0)
        tint = share / np.maximum(weight, 1e-6)
        head_on = np.float32(strongest) * weight * tint
        return ggx(decoded_srgb(colour[:, at]), head_on, alpha, angles, weight=weight * tint)

    return shown
