"""The small pictures of the page how-to.md, of what its recipes have made and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import impasto
from gallery.measured import background
from impasto import DistantLight, Scene
from impasto.pictures import Panel, Picture, contact_sheet, fitted, ramp_panel

WIDTH = 720
"""Columns of a picture, as wide as the page's text."""
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
    }


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
