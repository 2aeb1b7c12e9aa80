"""Universal RTI files, ``.rti``, of hemispherical harmonics.

A line ``#HSH1.2`` and other comments; the type (3); width, height, 3; the functions, the colours (1
luminance, 2 RGB), 1. Then little-endian float32 scales and biases, one per function, and for each
pixel, the highest row first, all codes of red, of green and of blue. (A ``.ptm`` begins with the
lowest row.) What relight writes and what RTIViewer reads agree on that order.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np

from impasto._internal.checks import one_of
from impasto._internal.damage import damage_of
from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_bytes
from impasto.io.rti.bases import Basis
from impasto.io.rti.image import RelightableImage
from impasto.io.rti.ptm import Header, check_pixels, check_scales, shared_terms

_HSH, _RGB = 3, 2


def read_rti(path: str | Path) -> RelightableImage:
    """Read an ``.rti``.

    Hemispherical harmonics of 4 or 9 functions in RGB are read.

    Raises
    ------
    CorruptInputError
        Truncated, damaged or no RTI.
    ArgumentError
        Not found, a kind that is not read, or larger than pictures may be.
    """
    path = Path(path)
    with closing(RegularFile(path)) as file:
        data = file.content()
    with damage_of(path, "an RTI file"):
        return _parsed(path, data)


def _parsed(path: Path, data: bytes) -> RelightableImage:
    if not data.startswith(b"#"):
        raise CorruptInputError(path, "is no RTI file: it does not begin with a line like #HSH1.2")
    header = Header(path, data)
    version = line = header.line()
    while line.startswith("#"):
        line = header.line()
    type_ = int(line.split()[0])
    width, height, channels = (int(word) for word in header.line().split()[:3])
    terms, colours, size = (int(word) for word in header.line().split()[:3])
    check_pixels(path, width, height)
    if type_ != _HSH or colours != _RGB or channels != 3 or size != 1:
        raise ArgumentError(
            f"{path}: holds RTI type {type_} of {channels} channels, colour type {colours} and "
            f"{size} bytes per code; read is type 3 (HSH), 3 channels, colour type 2 (RGB), 1 byte"
        )
    if terms not in {4, 9}:
        raise ArgumentError(f"{path}: holds {terms} hemispherical harmonics; read are 4 and 9")
    body = header.rest()
    expected = 8 * terms + width * height * 3 * terms
    if len(body) < expected:
        raise CorruptInputError(
            path,
            f"is truncated: {width} x {height} pixels of {terms} functions take {expected} bytes, "
            f"{len(body)} are there",
        )
    numbers = np.frombuffer(body, "<f4", 2 * terms)
    check_scales(path, numbers)
    scale, bias = numbers.astype(np.float64).reshape(2, terms)
    codes = np.frombuffer(body, np.uint8, expected - 8 * terms, 8 * terms)
    planes = np.moveaxis(codes.reshape(height, width, 3, terms), (3, 2), (0, 1))
    return RelightableImage(
        planes=np.ascontiguousarray(planes).reshape(3 * terms, height, width),
        scale=np.repeat(scale, 3) / 255.0,
        bias=np.repeat(bias, 3),
        basis=Basis("hsh", terms),
        format=f"universal RTI ({version.lstrip('#')[:20]})",
    )


def write_rti(path: str | Path, image: RelightableImage) -> None:
    """Write an ``.rti`` of hemispherical harmonics.

    Parameters
    ----------
    path
        The file to write (replaced atomically).
    image
        Hemispherical harmonics in ``rgb``, with one scale and one bias per function.

    Raises
    ------
    ArgumentError
        Other functions (a polynomial goes into a ``.ptm``), or scales that differ by channel.
    """
    one_of(image.basis.kind, ("hsh",), "image.basis.kind")
    one_of(image.colourspace, ("rgb",), "image.colourspace")
    scale, bias = shared_terms(image, 3)
    rows, columns = image.shape
    terms = image.basis.terms
    text = f"#HSH1.2\n3\n{columns} {rows} 3\n{terms} {_RGB} 1\n"
    numbers = np.concatenate([255.0 * scale, bias]).astype("<f4")
    planes = image.planes.reshape(terms, 3, rows, columns)
    body = np.ascontiguousarray(np.moveaxis(planes, (0, 1), (3, 2)))
    atomic_bytes(path, text.encode("ascii") + numbers.tobytes() + body.tobytes())
