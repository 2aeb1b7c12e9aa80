"""The planes of a compressed ``.ptm``: grey JPEGs, some as differences from others.

Behind the header: the quality; seven lines of a number per plane (transforms, motion in x and y,
the order of decoding, the reference plane or -1, bytes of the JPEG, bytes of its corrections); then
each plane's JPEG and its corrections, records of a pixel's number (four bytes, the highest first)
and its code.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.budget import check_claim
from impasto.io.images.read import decoded_jpeg

_RECORD = np.dtype([("pixel", ">u4"), ("code", "u1")])


class Numbers(Protocol):
    """The header's reader."""

    path: Path

    def numbers(self, count: int, kind: type[float] | type[int]) -> list[float]:
        """So many numbers."""
        ...

    def rest(self) -> bytes:
        """The bytes behind the header."""
        ...


def read_jpeg_planes(header: Numbers, width: int, height: int, count: int) -> NDArray[np.uint8]:
    """``(plane, y, x)`` codes, as the file orders rows and planes."""
    path = header.path
    header.numbers(1, int)  # the quality
    lines = [[int(one) for one in header.numbers(count, int)] for _ in range(7)]
    transforms, motion_x, motion_y, order, reference, sizes, patches = lines
    if any(transforms) or any(motion_x) or any(motion_y):
        raise ArgumentError(f"{path}: holds planes that are moved or transformed: not read")
    if sorted(order) != list(range(count)):
        raise CorruptInputError(path, "has an order of planes that is no order")
    body = header.rest()
    if min(sizes) < 0 or min(patches) < 0 or sum(sizes) + sum(patches) > len(body):
        raise CorruptInputError(path, "is truncated: the file ends inside its planes")
    check_claim(path, count * height * width, len(body), f"{count} planes of {width} x {height}")
    planes = np.zeros((count, height, width), np.uint8)
    done = np.zeros(count, bool)
    starts = np.concatenate([[0], np.cumsum(np.add(sizes, patches))])
    for plane in np.argsort(order):
        first = int(starts[plane])
        jpeg = body[first : first + sizes[plane]]
        found = decoded_jpeg(path, jpeg, width, height)
        source = reference[plane]
        if source >= 0:
            if source >= count or not done[source]:
                raise CorruptInputError(path, "has a plane that refers to one not decoded yet")
            found = found - np.uint8(128) + planes[source]  # bytes wrap
        _patch(path, found, body[first + sizes[plane] : int(starts[plane + 1])])
        planes[plane] = found
        done[plane] = True
    return planes


def _patch(path: Path, plane: NDArray[np.uint8], data: bytes) -> None:
    if len(data) % _RECORD.itemsize:
        raise CorruptInputError(path, "has corrections that are no whole records")
    records = np.frombuffer(data, _RECORD)
    if len(records) and int(records["pixel"].max()) >= plane.size:
        raise CorruptInputError(path, "corrects a pixel outside of the picture")
    plane.reshape(-1)[records["pixel"].astype(np.int64)] = records["code"]
