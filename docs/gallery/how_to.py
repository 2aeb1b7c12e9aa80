"""The small pictures of the page how-to.md, of what its recipes have made and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import impasto
from gallery import how_to_files
from gallery.measured import background
from impasto import DistantLight, Scene
from impasto.pictures import (
    Panel,
    Picture,
    Series,
    bar_panel,
    colour_panel,
    contact_sheet,
    diagram_panel,
    fitted,
    normal_panel,
    ramp_panel,
    status_panel,
)
from impasto.pictures.diagrams import AMBER, BLUE
from impasto.pictures.panels import FAINT, INK

WIDTH = 720
"""Columns of a picture, as wide as the page's text."""
FRAME = (255, 255, 255)
ABOVE = Scene([DistantLight((0.0, 0.71, 0.71))])
SIDES = {"from the right": 0, "from above": 2, "from the left": 4}
"""From where the light comes in three of the eight pictures of the film."""


def read(path: Path) -> Picture:
    """8-bit RGB of a file of 8 or 16 bits."""
    codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if codes is None:
        raise SystemExit(f"{path} cannot be read")
    if codes.dtype == np.uint16:
        codes = np.rint(codes / 257.0).astype(np.uint8)
    return np.ascontiguousarray(codes[..., 2::-1])


def narrowed(picture: Picture, width: int = WIDTH) -> Picture:
    """A picture no wider than the page."""
    rows, columns = picture.shape[:2]
    width = min(width, columns)
    return fitted(picture, width, round(width * rows / columns))


def pictures(folder: Path, names: Mapping[str, Any]) -> dict[str, Picture]:
    """Name and picture of each figure but those of a browser.

    Parameters
    ----------
    folder
        Where the recipes ran.
    names
        What they defined.
    """
    return {
        "balls": narrowed(read(folder / "calibration" / "lamps.png")),
        "chart": narrowed(read(folder / "calibration" / "camera.png")),
        "gilding": contact_sheet(gilding(names), columns=3, width=300),
        "lobe": narrowed(read(folder / "lobe.png")),
        "candle": narrowed(read(folder / "candle.png"), 420),
        "raking": contact_sheet(raking(folder / "raking.gif"), columns=3, width=150),
        "height": contact_sheet(
            [ramp_panel(names["height"], "Height", unit="mm")], columns=1, width=420
        ),
        "crop": contact_sheet(crop(names), columns=2, width=260),
        "mask": contact_sheet(mask(names["normals"]), columns=2, width=300),
        "tiff": contact_sheet(
            [
                Panel("normal.tif", read(folder / "normal.tif"), "16 bits"),
                Panel("picture.tif", read(folder / "picture.tif"), "16 bits, sRGB"),
            ],
            columns=2, width=210,
        ),
        "matte": contact_sheet(matte(names), columns=2, width=230),
        "spectrum": contact_sheet([spectrum(folder / "spectrum.csv")], columns=1, width=420),
        "regions": contact_sheet(regions(names), columns=2, width=250),
        "normal-map": contact_sheet(
            [Panel("normal-map.png", read(folder / "normal-map.png"), "green up")],
            columns=1, width=290,
        ),
        "gltf": contact_sheet(how_to_files.textures(folder / "painting.glb"), columns=3, width=170),
        "stl": contact_sheet([relief(folder / "relief.stl")], columns=1, width=300),
        "scales": contact_sheet(
            scales(folder / "large.impasto.zarr", names["camera"]), columns=3, width=180
        ),
    }  # fmt: skip


def crop(names: Mapping[str, Any]) -> list[Panel]:
    """The whole with the frame of the crop, and the crop."""
    whole = colour_panel(names["stack"].linear(0), "The whole").picture.copy()
    top, left, rows, columns = 10, 20, 32, 40
    cv2.rectangle(whole, (left, top), (left + columns, top + rows), FRAME, 2)
    return [
        Panel("The whole", whole, "the first photograph"),
        colour_panel(names["detail"].linear(0), "--region 10 20 32 40"),
    ]


def mask(normals: impasto.Normals) -> list[Panel]:
    """What is estimated inside a mask, and the statuses."""
    return [Panel("Normals", normal_panel(normals.normal).picture), status_panel(normals.status)]


def matte(names: Mapping[str, Any]) -> list[Panel]:
    """Matte paint in light from the side, and what its samples leave of the fit."""
    light = Scene([DistantLight((-0.6, 0.3, 0.74))], background=background())
    paint = names["paint"]
    return [
        Panel("Without a lobe", impasto.render(paint, light).display, "lit from the left"),
        ramp_panel(paint.residual, "Residual", unit="% of white", scale=100.0, low=0.0),
    ]


def spectrum(path: Path) -> Panel:
    """The columns of the file that a recipe wrote."""
    nanometres, value, lower, upper = np.loadtxt(path, delimiter=",").T
    lines = [
        Series("95 % of the errors", np.stack([nanometres, bound], axis=1), FAINT)
        for bound in (lower, upper)
    ]
    lines[1] = Series("", lines[1].points, FAINT)
    lines.append(Series("Reflectance", np.stack([nanometres, value], axis=1), INK))
    ends = float(nanometres[0]), float(nanometres[-1])
    top = 0.1 * np.ceil(10.0 * float(upper.max()))
    return diagram_panel(
        lines, "spectrum.csv", x=ends, y=(0.0, top),
        axis=(f"{ends[0]:.0f} nm", f"{ends[1]:.0f} nm"), size=(300, 460),
    )  # fmt: skip


def regions(names: Mapping[str, Any]) -> list[Panel]:
    """Regions that were drawn, and the width of the lobe of each."""
    drawn, table = names["regions"], names["table"]
    colours = (AMBER, BLUE)
    picture = colour_panel(names["stack"].linear(0), "").picture
    tint = np.array(colours, np.float64)[drawn]
    shown = np.rint(0.55 * picture + 0.45 * tint).astype(np.uint8)
    bars = [
        (f"region {number}", float(np.degrees(gamma)), colours[number])
        for number, gamma in enumerate(table["segment_gamma"])
    ]
    return [
        Panel("Regions", shown),
        bar_panel(bars, "Width of the lobe", note="degrees", size=picture.shape[:2]),
    ]


def relief(path: Path) -> Panel:
    """The mesh for a printer."""
    picture, (wide, high, deep) = how_to_files.facets(path, (-0.8, 0.45, 0.4))
    return Panel("relief.stl", picture, f"{wide:.0f} x {high:.0f} x {deep:.1f} mm")


def scales(path: Path, camera: impasto.Camera) -> list[Panel]:
    """A store at two of its scales, and a part of single pixels."""
    store = impasto.open_sbrdf(path)
    shown = [
        Panel(
            f"1/{factor}",
            impasto.render(store.level(factor), ABOVE, camera=camera).display,
            _size(level),
        )
        for factor in store.factors[:2]
        if (level := store.level_shape(factor))
    ]
    part = store[10:42, 20:60]
    return [
        *shown,
        Panel("A part", impasto.render(part, ABOVE, camera=camera).display, _size(part.shape)),
    ]


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[1]} x {shape[0]}"


def gilding(names: Mapping[str, Any]) -> list[Panel]:
    """The gilded painting, where its lobes are coloured, and how wide they are."""
    leaf, gold = names["leaf"], names["gold"]
    light = Scene([DistantLight((0.0, 0.1, 0.99))], background=background(), exposure=0.8)
    width = np.where(leaf.lobes > 0, np.degrees(leaf.gamma[0]), np.nan)
    return [
        Panel("Lit from the front", impasto.render(leaf, light).display),
        Panel(
            "Coloured lobes", np.repeat((40 + 190 * gold).astype(np.uint8)[..., None], 3, axis=2)
        ),
        ramp_panel(width, "Width of the lobes", unit="degrees", low=0.0, high=20.0),
    ]


def raking(film: Path) -> list[Panel]:
    """Some pictures of a film."""
    reader = cv2.VideoCapture(str(film))
    frames = []
    while (found := reader.read())[0]:
        frames.append(np.ascontiguousarray(found[1][..., ::-1]).astype(np.uint8))
    return [Panel(side, frames[at]) for side, at in SIDES.items()]
