"""A real icon on gilded wood, measured from photographs that lie beside the checkout.

72 photographs of the example data of NeuralRTI (Dulecha et al. 2020, MIT licence), one light each.
Every sixth was held out: no fit here has seen it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impasto
from gallery.measured import CANDLE, EYES, Measured, difference
from impasto import Camera, DistantLight, Environment, PointLight, PointView, Scene, Stack, Varnish
from impasto.colour import Display
from impasto.pictures import Panel

HELD_OUT = 6
"""Every so many-th photograph is held out."""
SHOWN = (24, 60, 66, 18)
"""Photographs beside their renderings, by their place among all: near the highlight, where a
prediction is hardest, to raking light."""
PITCH_MM = 0.25
"""Width of a pixel, assumed: the size of the icon is not known. Only distances of candle and eye
in millimetres depend on it."""
BESIDE = PointView((170.0, 10.0, 240.0))
"""An eye 35 degrees to the right."""
FLAME = PointLight((-30.0, 62.0, 200.0), radius=6.0)
"""A candle before the gilded ground, upper left."""
EXPOSURES = {0.0: 0.32, 0.56: 0.42, 1.0: 0.58}
"""Of candlelight; gold is brighter than a white board."""
SRGB = Display.named("srgb")


@dataclass(frozen=True, eq=False)
class Icon:
    """The icon, measured, and all its photographs.

    Attributes
    ----------
    photographs
        All photographs, upright.
    measured
        The fit of those that were not held out.
    """

    photographs: Stack
    measured: Measured


def folder() -> Path:
    """Where the photographs are if they are at hand."""
    root = Path(__file__).resolve().parents[2]
    return Path(os.environ.get("IMPASTO_DATA", root.parent / "shared" / "data")) / "icon_rti"


def upright(photographs: Path) -> Stack:
    """The photographs, in which the icon lies on its side, upright."""
    return impasto.read_stack(photographs / "dirs.lp", encoding="srgb").rotated(1)


def measured(stack: Stack, *, refine: bool | None = None) -> Icon:
    """Measure the icon from five of every six photographs; ``refine`` as in the fit."""
    train = [index for index in range(len(stack.rig)) if index % HELD_OUT]
    sbrdf = impasto.fit_sbrdf(stack.take(train), refine=refine)
    reflectance = impasto.fit_reflectance(None, sbrdf, Camera.srgb())
    options = {"level": True, "pitch_mm": PITCH_MM}
    return Icon(stack, Measured(sbrdf, reflectance, options))


def in_the_gallery(icon: Icon) -> list[Panel]:
    """The gallery from the front and slanted, and raking light."""
    room = Scene(environment=Environment.named("gallery"), exposure=1.3)
    slanted = room.changed(view=BESIDE, perspective=True, exposure=0.9)
    raking = Scene([DistantLight((-0.95, 0.22, 0.21))], shadows=True, exposure=4.0)
    found = icon.measured
    return [
        found.panel("In the gallery", "from the front", room),
        found.panel("The same", "35 degrees from the right", slanted),
        found.panel("Raking light", "from the left, 12 degrees", raking),
    ]


def by_candlelight(icon: Icon) -> list[Panel]:
    """A near flame before the gold, for eyes adapted to it by three degrees."""
    scene = Scene([FLAME], illuminant=CANDLE)
    return [
        icon.measured.panel(
            "By candlelight",
            EYES[degree],
            scene.changed(adaptation=degree, exposure=exposure),
        )
        for degree, exposure in EXPOSURES.items()
    ]


def with_varnish(icon: Icon) -> list[Panel]:
    """The icon as it is, under a browner varnish, and with a part of its own taken off."""
    scene = Scene(environment=Environment.named("gallery"), exposure=1.3)
    own = Varnish(yellowness=2.0)
    browner = Varnish(yellowness=10.0, gamma=0.08)
    found = icon.measured
    return [
        found.panel("As it is", "its old varnish", scene),
        found.panel("Varnished again", "a yellowed coat", scene.changed(varnish=browner)),
        found.panel("Varnish removed", "assumed to be pale", scene.changed(varnish=own.without())),
    ]


def beside_photographs(icon: Icon) -> list[Panel]:
    """Photographs that were held out, and below them the icon under their lights."""
    above, below = [], []
    for index in SHOWN:
        photograph = np.minimum(icon.photographs.linear(index), 1.0)
        picture = relit(icon, index)
        linear = np.clip(picture.linear, 0.0, 1.0)
        elevation = np.degrees(np.arcsin(icon.photographs.rig.directions[index, 2]))
        decibels = psnr(codes(photograph), codes(linear))
        colours = difference(*(_xyz(light) for light in (photograph, linear)))
        above.append(
            Panel("Photograph", codes(photograph), f"held out, light at {elevation:.0f} degrees")
        )
        below.append(Panel("Rendering", codes(linear), f"{decibels:.1f} dB, dE00 {colours:.1f}"))
    return above + below


def relit(icon: Icon, index: int) -> Any:
    """The icon under the light of one photograph, as the camera saw it."""
    scene = Scene([icon.photographs.rig.lights[index]], exposure=1.0)
    return impasto.render(icon.measured.sbrdf, scene)


def codes(linear: NDArray[Any]) -> NDArray[np.uint8]:
    """8-bit sRGB ``(y, x, 3)`` of linear light ``(3, y, x)``."""
    coded = np.rint(255.0 * SRGB.curve.encode(linear)).astype(np.uint8)
    return np.ascontiguousarray(np.moveaxis(coded, 0, -1))


def psnr(picture: NDArray[np.uint8], truth: NDArray[np.uint8]) -> float:
    """Decibels over all pixels and channels, on 8-bit codes."""
    error = picture.astype(np.float64) - truth
    return float(10.0 * np.log10(255.0**2 / (error**2).mean()))


def _xyz(linear: NDArray[Any]) -> NDArray[Any]:
    return np.tensordot(SRGB.xyz_from_linear, linear, axes=1)
