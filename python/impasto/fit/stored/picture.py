"""Pictures of paintings of any size, written part by part."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import instance
from impasto._internal.windows import Window
from impasto.colour import icc_profile
from impasto.errors import ArgumentError
from impasto.image import CHANNELS, Image
from impasto.io.images.bands_of_rows import TIFF_TILE, write_tiff_rows
from impasto.picture import Backend, Fidelity
from impasto.render import render
from impasto.rig import PointView
from impasto.scene import Scene

WIDE = 1024
"""Columns of a part, about: as many as whole tiles of the source have."""
SAMPLED = 16
"""Of every so many rows and columns the brightness is kept, for :attr:`PictureFile.bright`."""


class Parts(Protocol):
    """A painting whose parts can be loaded: :class:`impasto.StoredSbrdf`."""

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""

    @property
    def tile(self) -> int:
        """Rows and columns of what is best read together."""

    def visible(self, rows: slice, columns: slice) -> Any:
        """A part, as :func:`impasto.render` takes it."""

    def statistics(self) -> tuple[int, NDArray[np.float64]] | None:
        """Rows and columns of tiles, and statistics ``(number, y, x)`` of their pieces, if kept."""


@dataclass(frozen=True)
class PictureFile:
    """A picture that was written and is not in memory.

    Attributes
    ----------
    path
        The file.
    shape
        ``(y, x)``.
    exposure
        The factor from XYZ to display light.
    clipped
        For each channel, the share of pixels that are too bright for the display.
    covered
        Share of the pixels that show the painting.
    bright
        Linear display light that 99 % of the pixels of the painting do not exceed, from every
        16th row and column; 0 without any pixel.
    """

    path: Path
    shape: tuple[int, int]
    exposure: float
    clipped: dict[str, float]
    covered: float
    bright: float


def render_parts(
    painting: Parts,
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    region: Window | None = None,
    bands: Sequence[int] | None = None,
    fidelity: Fidelity = "photographs",
    tolerance: str | float | None = None,
    backend: Backend = "cpu",
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
    **options: Any,
) -> PictureFile:
    """Render a painting part by part into a tiled 16-bit TIFF; see :meth:`StoredSbrdf.render`."""
    check_local(scene)
    whole: Window = (slice(0, painting.shape[0]), slice(0, painting.shape[1]))
    rows, columns = whole if region is None else region
    size = rows.stop - rows.start, columns.stop - columns.start
    lit: dict[str, Any] = {"fidelity": fidelity, "backend": backend, "threads": threads}
    lit |= {"tolerance": tolerance, **options}
    passes = 2 if isinstance(scene.exposure, str) else 1
    counted = _Numbers()
    with reporting(progress, "rendering") as callback:
        done = _Done(callback, passes * size[0] * size[1])

        def images(shown: Scene, window: Window) -> Iterator[tuple[Window, Image]]:
            for part in _parts(painting, window):
                surface = painting.visible(*part)
                surface = surface if bands is None else surface.with_bands(list(bands))
                yield part, render(surface, shown, output="light", **lit)
                done.add(part)

        if passes == 2:
            scene = _brightest(scene, images, (rows, columns))

        def bands_of_rows() -> Iterator[NDArray[np.uint16]]:
            for top in range(rows.start, rows.stop, TIFF_TILE):
                strip = slice(top, min(top + TIFF_TILE, rows.stop))
                codes = np.empty((3, strip.stop - top, size[1]), np.uint16)
                for (_, across), image in images(scene, (strip, columns)):
                    left = across.start - columns.start
                    coded = image.screen.encode(image.linear)
                    wide = slice(left, left + coded.shape[2])
                    codes[:, :, wide] = np.rint(np.clip(coded, 0.0, 1.0) * 65535.0)
                    counted.add(image)
                yield codes

        write_tiff_rows(
            Path(path),
            bands_of_rows(),
            size,
            planes=3,
            dtype=np.uint16,
            icc=icc_profile(scene.display),
        )
    return counted.file(Path(path), size)


def check_local(scene: Scene) -> None:
    """Refuse what a pixel of a picture needs from far away in the painting.

    Raises
    ------
    ArgumentError
        Shadows, parallax, a perspective or a view from the side.
    """
    instance(scene, Scene, "scene", "an impasto.Scene, as in Scene([DistantLight((0, 1, 1))])")
    slanted = not isinstance(scene.view, PointView | None) and np.any(np.asarray(scene.view)[:2])
    found = {
        "shadows": scene.shadows,
        "parallax": scene.has_parallax,
        "perspective": scene.perspective,
        "view": slanted,
    }
    names = [name for name, there in found.items() if there]
    if names:
        raise ArgumentError(
            f"{names[0]}: a picture that is made part by part has none of {', '.join(found)} from "
            "the side, which need the whole painting; render a smaller scale, .level(factor), or a "
            "detail, stored[y0:y1, x0:x1], with impasto.render (impasto render: --width, --region)"
        )


def _parts(painting: Parts, window: Window) -> Iterator[Window]:
    """Parts of some rows from left to right, as wide as whole tiles of the source."""
    rows, columns = window
    side = painting.tile * max(1, WIDE // painting.tile)
    left = columns.start
    while left < columns.stop:
        right = min((left // side + 1) * side, columns.stop)
        yield rows, slice(left, right)
        left = right


def _brightest(
    scene: Scene, images: Callable[[Scene, Window], Iterator[tuple[Window, Image]]], window: Window
) -> Scene:
    """The scene with the exposure at which its brightest pixel is the display's white."""
    highest = 0.0
    even = scene.changed(exposure=1.0)
    rows, columns = window
    for top in range(rows.start, rows.stop, TIFF_TILE):
        strip = slice(top, min(top + TIFF_TILE, rows.stop))
        for _, image in images(even, (strip, columns)):
            shown = image.xyz[1][image.coverage > 0.0]
            highest = max(highest, float(shown.max(initial=0.0)))
    return scene.changed(exposure=1.0 / highest if highest > 0.0 else 1.0)


class _Done:
    """Tells how many pixels are done."""

    def __init__(self, callback: ProgressCallback | None, total: int) -> None:
        self._callback, self._total, self._count = callback, total, 0

    def add(self, part: Window) -> None:
        rows, columns = part
        self._count += (rows.stop - rows.start) * (columns.stop - columns.start)
        if self._callback is not None:
            self._callback(self._count, self._total)


class _Numbers:
    """What is known of a picture whose parts are gone."""

    def __init__(self) -> None:
        self._pixels = 0
        self._above = np.zeros(3, np.int64)
        self._covered = 0.0
        self._bright: list[NDArray[np.float32]] = []
        self._exposure = 1.0

    def add(self, image: Image) -> None:
        size = image.coverage.size
        self._pixels += size
        self._above += np.rint([image.clipped[name] * size for name in CHANNELS]).astype(np.int64)
        self._covered += float(image.coverage.sum(dtype=np.float64))
        picked = np.s_[::SAMPLED, ::SAMPLED]
        shown = image.valid[picked]
        self._bright.append(image.linear[:, ::SAMPLED, ::SAMPLED].max(axis=0)[shown])
        self._exposure = image.exposure

    def file(self, path: Path, shape: tuple[int, int]) -> PictureFile:
        known = np.concatenate(self._bright)
        return PictureFile(
            path=path,
            shape=shape,
            exposure=self._exposure,
            clipped=dict(zip(CHANNELS, (self._above / self._pixels).tolist(), strict=True)),
            covered=self._covered / self._pixels,
            bright=float(np.percentile(known, 99.0)) if known.size else 0.0,
        )
