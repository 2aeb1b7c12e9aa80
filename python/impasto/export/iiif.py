"""A picture for IIIF viewers without a server: Image API 3.0 [@iiif-image], level 0, static tiles.

``info.json``, ``full/max/0/default.jpg``, whole pictures at smaller sizes, and tiles under
``left,top,width,height/width,height/0/default.jpg``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import numpy as np
from numpy.typing import NDArray

from impasto.colour import delta_e, icc_profile
from impasto.errors import ArgumentError
from impasto.export.folder import export_folder
from impasto.export.loss import REPORT, LossReport, percentiles, seen, written
from impasto.export.source import Map, Source
from impasto.export.stored import LOADED, SAMPLED, StoredSource
from impasto.export.textures import decoded_srgb
from impasto.fit.stored.picture import check_local
from impasto.image import Image
from impasto.io.images.read import read_image
from impasto.io.images.write import write_jpeg, write_json
from impasto.lights import DistantLight
from impasto.render import render
from impasto.scene import Scene

TILE = 512
WIDE = 4 * TILE
"""Columns of the parts of a store that are lit at a time."""
COMPARED = 20_000
"""Pixels of a whole picture that are compared, about."""
CONTEXT = "http://iiif.io/api/image/3/context.json"
PLACEHOLDER = "https://example.org/iiif"
"""Where the folder is to be served, unless said otherwise: ``id`` must be a URL."""


def export_iiif(
    source: Source,
    out: Path,
    *,
    scene: Scene | None = None,
    url: str | None = None,
    quality: int = 97,
) -> LossReport:
    """Write the folder.

    Parameters
    ----------
    source
        The painting.
    out
        The folder.
    scene
        How it is lit; default: from above at 45 degrees, the light of the papers.
    url
        Where the folder will be served: the ``id`` of ``info.json``.
    quality
        Of the JPEGs, 1 to 100.

    Raises
    ------
    ArgumentError
        No address of a web server, or no quality.
    """
    lit = scene or Scene([DistantLight((0.0, 0.71, 0.71))])
    url = None if url is None else _checked(url)
    image = render(source.result, lit, reflectance=source.reflectance, pitch_mm=source.pitch_mm)
    strips = (
        replace_light(image, image.xyz[:, top : top + TILE])
        for top in range(0, image.coverage.shape[0], TILE)
    )
    return _export(strips, image.coverage.shape, out, url, quality)


def export_iiif_tiles(
    source: StoredSource,
    out: Path,
    *,
    scene: Scene | None = None,
    url: str | None = None,
    quality: int = 97,
) -> LossReport:
    """Write the folder of a painting of any size, in the memory of some rows of tiles.

    The options are those of :func:`export_iiif`; whole pictures are written from the scale on that
    has :data:`~impasto.export.stored.LOADED` pixels at most, and ``max`` is the largest of these.

    Raises
    ------
    ArgumentError
        A scene whose effects need the whole painting, such as shadows or ``exposure="maximum"``.
    """
    lit = scene or Scene([DistantLight((0.0, 0.71, 0.71))])
    url = None if url is None else _checked(url)
    check_local(lit)
    if isinstance(lit.exposure, str):
        raise ArgumentError(
            f"scene: exposure={lit.exposure!r} needs the whole painting; give a number"
        )
    rows, columns = source.shape

    def strips() -> Iterator[Image]:
        for top in range(0, rows, TILE):
            parts = []
            for left in range(0, columns, WIDE):
                window = slice(top, min(top + TILE, rows)), slice(left, min(left + WIDE, columns))
                part = source.part(window)
                parts.append(render(part.result, lit, pitch_mm=part.pitch_mm, output="light"))
            yield replace_light(parts[0], np.concatenate([one.xyz for one in parts], axis=2))

    return _export(strips(), source.shape, out, url, quality)


def replace_light(image: Image, xyz: Map) -> Image:
    """A picture of other light with the exposure and the display of one."""
    return Image(np.ones(xyz.shape[1:], np.float32), image.exposure, image.screen, xyz)


def _export(
    strips: Iterable[Image], shape: tuple[int, int], out: Path, url: str | None, quality: int
) -> LossReport:
    rows, columns = shape
    with export_folder(out) as folder:
        tiled = TiledPicture(folder, shape, quality)
        for strip in strips:
            tiled.add(strip)
        sizes = tiled.finish()
        info: dict[str, Any] = {
            "@context": CONTEXT,
            "id": url or f"{PLACEHOLDER}/{quote(out.name)}",
            "type": "ImageService3",
            "protocol": "http://iiif.io/api/image",
            "profile": "level0",
            "width": columns,
            "height": rows,
            "sizes": sizes[::-1],
            "tiles": [{"width": TILE, "height": TILE, "scaleFactors": factors_of(shape)}],
        }
        if sizes[0]["width"] < columns:
            info |= {"maxWidth": sizes[0]["width"], "maxHeight": sizes[0]["height"]}
        write_json(folder / "info.json", info)
        files = [path for path in folder.rglob("*") if path.is_file()]
        report = _report(tiled.differences, written(files, folder), url)
        report.save(folder / REPORT)
    return report


def _checked(url: str) -> str:
    """The address without a slash at its end, as the API has it."""
    try:
        parts = urlsplit(url)
    except ValueError:  # brackets that hold no IPv6 address
        parts = urlsplit("")
    plain = url.isascii() and url.isprintable() and not set(url) & set(' <>"{}|\\^`?#')
    if parts.scheme not in {"http", "https"} or not parts.netloc or not plain:
        raise ArgumentError(
            f"url: expected where the folder will be served, such as {PLACEHOLDER}, found {url!r}"
        )
    return url.rstrip("/")


def factors_of(shape: tuple[int, int]) -> list[int]:
    """Scale factors, up to the one at which a single tile holds all."""
    steps = max(1, math.ceil(math.log2(max(shape) / TILE)) + 1)
    return [1 << level for level in range(steps)]


class TiledPicture:
    """Tiles and whole pictures at all scales, from rows of the largest one.

    Each further scale is the mean of the light of 2 x 2 pixels of the one before, with the sizes
    that the API defines: rounded up. A scale keeps as many rows as a tile has.

    Parameters
    ----------
    folder
        It exists.
    shape
        ``(y, x)`` of the picture.
    quality
        Of the JPEGs.
    """

    def __init__(self, folder: Path, shape: tuple[int, int], quality: int) -> None:
        self._folder, self._shape, self._quality = folder, shape, quality
        self._factors = factors_of(shape)
        self._waiting: list[list[Map]] = [[] for _ in self._factors]
        self._tops = [0 for _ in self._factors]
        self._whole: list[list[NDArray[np.uint8]]] = [[] for _ in self._factors]
        self._kept = [rows * columns <= LOADED for rows, columns in map(self._size, self._factors)]
        self._kept[-1] = True
        self._step = max(1, math.isqrt(shape[0] * shape[1] // COMPARED))
        self._meant: list[Map] = []
        self._image: Image | None = None
        self._icc: bytes | None = None
        self.differences: list[NDArray[np.float64]] = []
        """CIEDE2000 of some pixels between what was meant and what was written."""

    def add(self, strip: Image) -> None:
        """Add the next rows of the picture."""
        if self._image is None:
            self._image, self._icc = strip, icc_profile(strip.screen)
        self._rows(0, strip.xyz)

    def finish(self) -> list[dict[str, int]]:
        """Write what is left, and whole pictures; their sizes, the largest first."""
        sizes: list[dict[str, int]] = []
        for number, kept in enumerate(self._kept):
            self._flush(number, last=True)
            if not kept:
                continue
            codes = np.concatenate(self._whole[number])
            tall, wide = codes.shape[:2]
            for name in [f"{wide},{tall}"] + ["max"] * (not sizes):
                self._put(self._folder / "full" / name, codes)
            sizes.append({"width": wide, "height": tall})
        if self._kept[0]:
            linear = np.concatenate(self._meant, axis=1)
            self._compare(self._folder / "full" / "max", linear, self._step)
        return sizes

    def _size(self, factor: int) -> tuple[int, int]:
        return -(-self._shape[0] // factor), -(-self._shape[1] // factor)

    def _rows(self, number: int, xyz: Map) -> None:
        self._waiting[number].append(xyz)
        self._flush(number)

    def _flush(self, number: int, *, last: bool = False) -> None:
        waiting = self._waiting[number]
        count = sum(one.shape[1] for one in waiting)
        if not count or (count < TILE and not last):
            return
        rows = np.concatenate(waiting, axis=1)
        self._waiting[number] = []
        for top in range(0, count, TILE):
            strip = rows[:, top : top + TILE]
            if strip.shape[1] < TILE and not last:
                self._waiting[number] = [strip]
                return
            self._write(number, strip)
            if number + 1 < len(self._factors):
                self._rows(number + 1, _halved(strip))

    def _write(self, number: int, xyz: Map) -> None:
        """The tiles of one row of a scale."""
        assert self._image is not None
        strip = replace_light(self._image, xyz)
        codes = strip.display
        factor, top = self._factors[number], self._tops[number]
        if self._kept[number]:
            self._whole[number].append(codes)
            if number == 0:
                first = -self._tops[0] % self._step
                self._meant.append(strip.linear[:, first :: self._step, :: self._step])
        self._tops[number] += codes.shape[0]
        rows, columns = self._shape
        if self._size(factor)[0] <= TILE and self._size(factor)[1] <= TILE:
            return  # the whole picture has its own name
        height = min(TILE * factor, rows - top * factor)
        for left in range(0, codes.shape[1], TILE):
            part = codes[:, left : left + TILE]
            width = min(TILE * factor, columns - left * factor)
            region = f"{left * factor},{top * factor},{width},{height}"
            place = self._folder / region / f"{part.shape[1]},{part.shape[0]}"
            self._put(place, part)
            if number == 0 and not self._kept[0] and self._sampled(left, top):
                self._compare(place, strip.linear[:, ::8, left : left + TILE : 8])

    def _put(self, folder: Path, codes: NDArray[np.uint8]) -> None:
        target = folder / "0"
        target.mkdir(parents=True, exist_ok=True)
        # As planes: of one or three rows it could not be told where the channels are.
        planes = np.moveaxis(codes, -1, 0)
        write_jpeg(target / "default.jpg", planes, quality=self._quality, icc=self._icc)

    def _sampled(self, left: int, top: int) -> bool:
        """Whether a tile is one of some, spread evenly."""
        across = -(-self._shape[1] // TILE)
        total = across * -(-self._shape[0] // TILE)
        number = top // TILE * across + left // TILE
        return number % max(1, total // SAMPLED) == 0

    def _compare(self, folder: Path, linear: Map, step: int = 8) -> None:
        """What a file shows of every so many rows and columns, against what was meant."""
        stored = read_image(folder / "0" / "default.jpg")[:, ::step, ::step].reshape(3, -1)
        meant = np.clip(linear, 0.0, 1.0).reshape(3, -1)
        self.differences.append(delta_e(seen(meant), seen(decoded_srgb(stored))))


def _halved(xyz: Map) -> Map:
    """Means of 2 x 2 pixels; the last row and column stand in for those that are missing."""
    rows, columns = xyz.shape[1:]
    padded = np.pad(xyz, ((0, 0), (0, rows % 2), (0, columns % 2)), "edge")
    groups = padded.reshape(3, -(-rows // 2), 2, -(-columns // 2), 2)
    return np.asarray(groups.mean(axis=(2, 4), dtype=np.float32))


def _report(
    differences: list[NDArray[np.float64]], files: tuple[tuple[str, int], ...], url: str | None
) -> LossReport:
    p50, p95, p99 = percentiles(np.concatenate(differences))
    lost = ["every light and view but this one"]
    if url is None:
        lost.append("where it is served: replace the id in info.json, or give its URL")
    return LossReport(
        "IIIF", ("one picture, at all scales",), tuple(lost), p50, p95, p99, files=files
    )
