"""relight's folder for the web: ``info.json`` and JPEG or PNG pictures of three planes each.

A coefficient is ``(code / 255 - bias) * scale``. Polynomials, hemispherical and spherical harmonics
in RGB or luminance, and radial functions in principal components are read [@ponchio2018compact].
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm, one_of
from impasto._internal.damage import damage_of
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.images.read import read_image
from impasto.io.images.write import write_jpeg, write_json, write_png8
from impasto.io.json_file import read_json
from impasto.io.rti.bases import Basis, Floats, unit_directions
from impasto.io.rti.image import RelightableImage
from impasto.io.rti.ptm import check_pixels, check_scales

INFO = "info.json"
_KINDS = ("ptm", "hsh", "sh", "rbf")
_COLOURS = ("rgb", "lrgb", "mrgb")
_MOST = 300
"""Planes: relight writes 9 to 60."""
Suffix = Literal["jpg", "png"]


def read_relight(path: str | Path) -> RelightableImage:
    """Read a folder of relight, or its ``info.json``.

    Its values are linear light, as relight decodes photographs.

    Raises
    ------
    CorruptInputError
        Damaged, or without the files that it names.
    ArgumentError
        Not found, or of functions or colours that are not read.
    """
    path = Path(path)
    info = path / INFO if path.is_dir() else path
    content = read_json(info)
    with damage_of(info, "the description of a relightable image"):
        return _parsed(info, content)


def _parsed(info: Path, content: dict[str, Any]) -> RelightableImage:
    kind, colours = str(content["type"]), str(content["colorspace"])
    if kind not in _KINDS or colours not in _COLOURS:
        raise ArgumentError(
            f"{info}: holds {kind[:20]} in {colours[:20]}, which is not read; known are "
            f"{', '.join(_KINDS)} in {', '.join(_COLOURS)}"
        )
    width, height, count = (int(content[name]) for name in ("width", "height", "nplanes"))
    check_pixels(info, width, height)
    if not 3 <= count <= _MOST:
        raise CorruptInputError(info, f"claims {count} planes, expected 3 to {_MOST}")
    suffix = str(content.get("format", "jpg"))
    if suffix not in {"jpg", "png"}:
        raise ArgumentError(f"{info}: planes in {suffix[:20]} are not read, those in jpg and png")
    material = content["materials"][0]
    scale, bias = (np.array(material[name], dtype=np.float64) for name in ("scale", "bias"))
    if scale.shape != (count,) or bias.shape != (count,):
        raise CorruptInputError(info, f"has {scale.size} scales for {count} planes")
    components = _components(content, material, count) if colours == "mrgb" else None
    check_scales(info, scale, bias, *(() if components is None else (components,)))
    planes = _planes(info, suffix, (width, height), count)
    lights = content.get("lights")
    directions = None if not lights else np.array(lights, dtype=np.float64).reshape(-1, 3)
    colour = None
    if colours == "lrgb":
        # The first picture holds the colour itself.
        colour, planes, scale, bias = planes[:3], planes[3:], scale[3:], bias[3:]
    with _described_by(info):
        return RelightableImage(
            planes=np.ascontiguousarray(planes),
            scale=scale / 255.0,
            bias=-bias * scale,
            basis=_basis(kind, colours, content, len(planes), directions),
            colourspace=colours,  # type: ignore[arg-type]
            coding="srgb" if content.get(_CODING) == "sRGB" else "linear",
            format=f"relight {kind}",
            colour=colour,
            components=components,
            lights=directions,
            pitch_mm=_pitch_mm(content.get("pixelSizeInMM")),
        )


@contextmanager
def _described_by(path: Path) -> Iterator[None]:
    """Numbers of a file that no relightable image can have are damage of the file."""
    try:
        yield
    except ArgumentError as error:
        raise CorruptInputError(path, f"describes no relightable image ({error})") from error


def _pitch_mm(value: Any) -> float | None:
    """The width of a pixel; None where the file has none, or what is none."""
    try:
        return length_mm(value, "pixelSizeInMM")
    except ArgumentError:
        return None


_CODING = "coding"
"""Our key for the coding of the values; relight has none and writes linear light."""


def _planes(info: Path, suffix: str, size: tuple[int, int], count: int) -> NDArray[np.uint8]:
    width, height = size
    pictures = []
    for number in range(-(-count // 3)):
        file = info.with_name(f"plane_{number}.{suffix}")
        picture = read_image(file)
        if picture.shape != (3, height, width) or picture.dtype != np.uint8:
            raise CorruptInputError(
                file, f"expected 3 x {height} x {width} codes of 8 bits, found {picture.shape}"
            )
        pictures.append(picture)
    return np.concatenate(pictures)[:count]


def _basis(
    kind: str, colours: str, content: dict[str, Any], count: int, lights: Floats | None
) -> Basis:
    if kind == "rbf":
        if lights is None:
            raise ArgumentError("lights: radial functions need one direction per term")
        return Basis("rbf", len(lights), unit_directions(lights), float(content["sigma"]))
    terms = count if colours == "lrgb" else count // 3
    return Basis(kind, terms)  # type: ignore[arg-type]


def _components(content: dict[str, Any], material: dict[str, Any], count: int) -> Floats:
    """``(plane + 1, function, 3)``; the mean is a code, components are codes about 127."""
    codes = np.array(content["basis"], dtype=np.float64).reshape(count + 1, -1, 3)
    ranges = np.array(material["range"], dtype=np.float64)
    if ranges.shape != (count,) or not (ranges > 0.0).all():
        raise ArgumentError("range: expected a positive number for each plane")
    found = (codes - 127.0) / np.concatenate([[1.0], ranges])[:, None, None]
    found[0] = codes[0] / 255.0
    return np.asarray(found)


def write_relight(
    folder: Path,
    image: RelightableImage,
    *,
    suffix: Suffix = "jpg",
    quality: int = 98,
    extra: dict[str, Any] | None = None,
) -> None:
    """Write ``info.json`` and the planes into an existing folder.

    Parameters
    ----------
    folder
        Where the files go.
    image
        A polynomial or harmonics in ``rgb``.
    suffix, quality
        ``"jpg"`` with its quality, which changes codes, or ``"png"``, which keeps them and which
        OpenLIME reads too.
    extra
        More keys of ``info.json``.
    """
    one_of(suffix, ("jpg", "png"), "suffix")
    one_of(image.colourspace, ("rgb",), "image.colourspace")
    rows, columns = image.shape
    scale = 255.0 * image.scale
    zero = scale == 0.0
    bias = np.where(zero, 0.0, -image.bias / np.where(zero, 1.0, scale))
    content: dict[str, Any] = {
        "width": columns,
        "height": rows,
        "format": suffix,
        "type": image.basis.kind,
        "colorspace": image.colourspace,
        "nplanes": len(image.planes),
        "quality": quality if suffix == "jpg" else 100,
        "materials": [{"scale": scale.tolist(), "bias": bias.tolist()}],
        _CODING: "sRGB" if image.coding == "srgb" else "linear",
    }
    if image.lights is not None:
        content["lights"] = [round(float(one), 3) for one in image.lights.ravel()]
    if image.pitch_mm is not None:
        content["pixelSizeInMM"] = image.pitch_mm
    for number in range(len(image.planes) // 3):
        picture = image.planes[3 * number : 3 * number + 3]
        file = folder / f"plane_{number}.{suffix}"
        if suffix == "jpg":
            write_jpeg(file, picture, quality=quality)
        else:
            write_png8(file, picture)
    write_json(folder / INFO, content | (extra or {}))
