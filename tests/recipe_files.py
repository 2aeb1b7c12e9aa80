"""Files that recipes of docs/how-to.md start from and that a reader brings: small, and simulated.

Balls and chart are the plain numpy of ``oracles``; RAW files are written from the specification of
DNG.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

import cleaned_painting
import impasto
from impasto import jobs, simulate
from impasto.calibrate.chart import GRID, chart_reflectances
from impasto.colour import spectrum
from impasto.io import write_jpeg, write_lights, write_png8, write_stack
from oracles import colour_chart, mirror_ball
from raw_files import mosaic_of, write_dng

GAMMA = 1.8
"""The tone curve of the photographs ``unknown``."""
SPARSE, DENSE = 16, 32
"""Lamps of most photographs, and of gilding."""
BALL = 55.0
"""Radius of the mirror balls in pixels; they are 22 mm wide."""
GILDED = np.s_[8:24, 12:30]
"""The rows and columns of ``gilded.npz`` that are gold."""
CLEANED = (44, 56)
WINDOW = np.s_[10:34, 16:42]
"""Size of the painting that is cleaned, and where."""


def write_files(folder: Path) -> None:
    """All files that the page names and does not make itself."""
    _from_a_camera(folder)
    _balls(folder / "with-balls")
    _chart(folder / "chart.tif")
    write_stack(folder / "gilded.npz", gilded())
    write_stack(folder / "matte.npz", matte())
    _cleaned(folder)


def directions(count: int) -> NDArray[np.float64]:
    """Unit vectors on a spiral, from 72 degrees above the painting down to 30."""
    azimuth = 2.399963 * np.arange(count)
    z = np.linspace(0.95, 0.5, count)
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)


def gilded() -> impasto.Stack:
    """Blue paint with a patch of gold leaf: a yellow lobe and hardly a diffuse part."""
    painting = simulate.painting(5, (32, 44), varnish=None, glazes=False)
    diffuse = painting.reflectance_in(simulate.camera("rgb"))
    strength = np.zeros((1, *diffuse.shape), np.float32)
    diffuse[(slice(None), *GILDED)] = 0.03
    strength[(0, slice(None), *GILDED)] = np.array([6.0, 4.5, 2.0])[:, None, None]
    gold = impasto.Surface.torrance_sparrow(painting.normal, diffuse, strength, np.array([0.2]))
    lamps = directions(DENSE)
    return impasto.Stack(gold.predict(lamps), lights=lamps, bands=("red", "green", "blue"))


def matte() -> impasto.Stack:
    """A painting without varnish, with the noise of a sensor."""
    painting = simulate.painting(6, (32, 44), varnish=None)
    return simulate.capture(painting, "tominaga-rgb-camera").stack


def _from_a_camera(folder: Path) -> None:
    """The same photographs as RAW files, and as JPEGs by a tone curve that nobody knows."""
    painting = simulate.painting(3, (64, 80))
    lamps = directions(SPARSE)
    rig = impasto.Rig([impasto.DistantLight(tuple(one)) for one in lamps.tolist()], pitch_mm=0.2)
    stack = simulate.capture(painting, rig, "rgb", noise=False, bits=None).stack
    for kind in ("raw", "unknown"):
        (folder / kind).mkdir()
    names = [f"photograph{number + 1:02}" for number in range(len(rig))]
    for number, name in enumerate(names):
        light = np.clip(stack.linear(number) * 0.8, 0.0, 1.0)
        write_dng(folder / "raw" / f"{name}.dng", mosaic_of(light.astype(np.float64)))
        codes = np.rint(255.0 * light ** (1.0 / GAMMA)).astype(np.uint8)
        write_jpeg(folder / "unknown" / f"{name}.jpg", np.moveaxis(codes, 0, -1), quality=97)
    write_lights(folder / "raw" / "lights.lp", rig, [f"{name}.dng" for name in names])
    write_lights(folder / "unknown" / "lights.lp", rig, [f"{name}.jpg" for name in names])
    outline = np.zeros((*painting.size, 3), np.uint8)
    cv2.ellipse(outline, (40, 32), (34, 26), 0.0, 0.0, 360.0, (255, 255, 255), -1)
    write_png8(folder / "mask.png", outline)


def _balls(folder: Path) -> None:
    """A flat panel with a mirror ball at either side, under six lamps."""
    folder.mkdir()
    size = (230, 430)
    random = np.random.default_rng(2)
    patches = cv2.resize(random.uniform(0.1, 0.5, (9, 14)), size[::-1], interpolation=3)
    for number, lamp in enumerate(directions(6)):
        picture = patches * lamp[2]
        for x in (-150.0, 150.0):
            picture = mirror_ball.photograph(
                np.array([x, -45.0, BALL]), BALL, [1e5 * lamp], size, glow=2.5, ground=picture
            )
        _write_tiff(folder / f"light{number + 1}.tif", np.repeat(picture[None], 3, axis=0))


def _chart(path: Path) -> None:
    """A ColorChecker under D50 by a camera whose bands are Gaussians."""
    bands = np.exp(-np.square((GRID - np.array([[600.0], [540.0], [460.0]])) / 45.0))
    weights = bands * spectrum("D50", GRID)
    weights *= 0.8 / weights.sum(axis=1, keepdims=True)
    _write_tiff(path, colour_chart.photograph(chart_reflectances() @ weights.T))


def _cleaned(folder: Path) -> None:
    """A painting before and after its varnish was taken off in a window."""
    window = np.zeros(CLEANED, np.bool_)
    window[WINDOW] = True
    one = cleaned_painting.cleaned_painting(CLEANED, window)
    for name, surface, seed in (("before", one.before, 1), ("after", one.after, 2)):
        write_stack(folder / f"{name}.npz", cleaned_painting.photographed(surface, seed))


def _write_tiff(path: Path, light: NDArray[np.float64]) -> None:
    """``(band, y, x)`` linear light as 16 bits."""
    codes = np.rint(65535.0 * np.clip(np.moveaxis(light, 0, -1), 0.0, 1.0)).astype(np.uint16)
    tifffile.imwrite(path, codes, photometric="rgb")


def interrupted_job(photographs: str, out: str) -> None:
    """A job that Ctrl-C ends after its first tile."""

    def interrupt(done: int, total: int) -> None:
        if jobs.status(out).tiles_done >= 1:
            raise KeyboardInterrupt

    try:
        reading = {"dark": 1024, "saturation": 65520}
        impasto.run(photographs, out, pooling="none", tile=32, reading=reading, progress=interrupt)
    except KeyboardInterrupt:
        return
    raise AssertionError(f"the job was not interrupted: {jobs.status(out)}")
