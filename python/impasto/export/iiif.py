"""A picture for IIIF viewers without a server: Image API 3.0 [@iiif-image], level 0, static tiles.

``info.json``, ``full/max/0/default.jpg``, whole pictures at smaller sizes, and tiles under
``left,top,width,height/width,height/0/default.jpg``.
"""

from __future__ import annotations

import math
from pathlib import Path
from urllib.parse import quote, urlsplit

import numpy as np
from numpy.typing import NDArray

from impasto.colour import delta_e, icc_profile
from impasto.errors import ArgumentError
from impasto.export.folder import export_folder
from impasto.export.loss import REPORT, LossReport, percentiles, seen, written
from impasto.export.source import Source
from impasto.export.textures import decoded_srgb
from impasto.image import Image
from impasto.io.images.read import read_image
from impasto.io.images.write import write_jpeg, write_json
from impasto.render import render
from impasto.rig import DistantLight
from impasto.scene import Scene

TILE = 512
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
    rows, columns = image.coverage.shape
    factors = [
        1 << level for level in range(max(1, math.ceil(math.log2(max(rows, columns) / TILE)) + 1))
    ]
    icc = icc_profile(image.screen)
    with export_folder(out) as folder:
        sizes = []
        for factor in factors:
            level = image if factor == 1 else _smaller(image, factor)
            codes = level.display
            tall, wide = codes.shape[:2]
            sizes.append({"width": wide, "height": tall})
            _tiles(folder, codes, (rows, columns), factor, quality, icc)
            names = [f"{wide},{tall}"] + ["max"] * (factor == 1)
            for name in names:
                _put(folder / "full" / name, codes, quality, icc)
        info = {
            "@context": CONTEXT,
            "id": url or f"{PLACEHOLDER}/{quote(out.name)}",
            "type": "ImageService3",
            "protocol": "http://iiif.io/api/image",
            "profile": "level0",
            "width": columns,
            "height": rows,
            "sizes": sizes[::-1],
            "tiles": [{"width": TILE, "height": TILE, "scaleFactors": factors}],
        }
        write_json(folder / "info.json", info)
        files = [path for path in folder.rglob("*") if path.is_file()]
        report = _report(image, folder, files, url)
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


def _smaller(image: Image, factor: int) -> Image:
    """Light averaged over areas, with the sizes that the API defines: rounded up."""
    rows, columns = image.coverage.shape
    tall, wide = -(-rows // factor), -(-columns // factor)
    more = ((0, 0), (0, tall * factor - rows), (0, wide * factor - columns))
    padded = np.pad(image.xyz, more, "edge")
    planes = padded.reshape(3, tall, factor, wide, factor).mean(axis=(2, 4), dtype=np.float32)
    cover = np.ones((tall, wide), np.float32)
    return Image(cover, image.exposure, image.screen, planes)


def _tiles(
    folder: Path,
    codes: NDArray[np.uint8],
    whole: tuple[int, int],
    factor: int,
    quality: int,
    icc: bytes | None,
) -> None:
    rows, columns = whole
    span = TILE * factor
    for top in range(0, rows, span):
        for left in range(0, columns, span):
            height, width = min(span, rows - top), min(span, columns - left)
            part = codes[top // factor : top // factor + -(-height // factor)]
            part = part[:, left // factor : left // factor + -(-width // factor)]
            region = f"{left},{top},{width},{height}"
            if (height, width) == whole:
                continue  # the whole picture has its own name
            _put(folder / region / f"{part.shape[1]},{part.shape[0]}", part, quality, icc)


def _put(folder: Path, codes: NDArray[np.uint8], quality: int, icc: bytes | None) -> None:
    target = folder / "0"
    target.mkdir(parents=True, exist_ok=True)
    write_jpeg(target / "default.jpg", codes, quality=quality, icc=icc)


def _report(image: Image, folder: Path, files: list[Path], url: str | None) -> LossReport:
    stored = read_image(folder / "full" / "max" / "0" / "default.jpg").reshape(3, -1)
    meant = np.clip(image.linear, 0.0, 1.0).reshape(3, -1)
    step = max(1, meant.shape[1] // 20_000)
    difference = delta_e(seen(meant[:, ::step]), seen(decoded_srgb(stored[:, ::step])))
    p50, p95, p99 = percentiles(difference)
    lost = ["every light and view but this one"]
    if url is None:
        lost.append("where it is served: replace the id in info.json, or give its URL")
    return LossReport(
        "IIIF",
        ("one picture, at all scales",),
        tuple(lost),
        p50,
        p95,
        p99,
        files=written(files, folder),
    )
