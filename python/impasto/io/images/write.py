"""Write pictures and maps: atomically, and the same bytes for the same numbers."""

from __future__ import annotations

import errno
import json
import os
import re
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import is_whole
from impasto.errors import ArgumentError
from impasto.io.files import atomic_bytes, atomic_path
from impasto.io.images.native_stderr import NO_MEMORY

_APP2_BYTES = 65519
"""Most bytes of a profile in one segment of a JPEG."""
_RESERVED = frozenset(
    {"channels", "compression", "dataWindow", "displayWindow", "lineOrder", "type"}
)


_SUFFIXES = {
    "OpenEXR": (".exr",),
    "PNG": (".png",),
    "JPEG": (".jpg", ".jpeg"),
    "TIFF": (".tif", ".tiff"),
}


def write_exr(
    path: str | Path,
    planes: Mapping[str, ArrayLike],
    *,
    attributes: Mapping[str, str | float | int] | None = None,
) -> None:
    """Write named planes as 32-bit float OpenEXR (lossless ZIP); NaN is kept.

    Parameters
    ----------
    path
        The file to write (replaced atomically).
    planes
        Name -> ``(y, x)``; dots make layers: ``"normal.X"``. All of one size.
    attributes
        Strings and numbers to carry along; numbers are stored as float.

    Raises
    ------
    ArgumentError
        No plane, planes of different size, a name that OpenEXR cannot hold, or a path that does
        not end in ``.exr``.
    """
    import OpenEXR

    channels: dict[str, NDArray[np.float32]] = {}
    for name, plane in planes.items():
        array = np.ascontiguousarray(plane, dtype=np.float32)
        if array.ndim != 2 or 0 in array.shape:
            raise ArgumentError(f"planes: {name!r} has shape {array.shape}, expected (y, x)")
        if not 0 < len(name.encode()) < 256 or "\0" in name:
            raise ArgumentError(f"planes: {name!r} cannot name an OpenEXR channel")
        channels[name] = array
    shapes = {name: array.shape for name, array in channels.items()}
    if len(set(shapes.values())) != 1:
        raise ArgumentError(f"planes: expected one or more planes of one size, found {shapes}")
    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    for key, value in sorted((attributes or {}).items()):
        if key in _RESERVED or not 0 < len(key) < 256:
            raise ArgumentError(f"attributes: {key!r} cannot be used as a name")
        header[key] = value if isinstance(value, str) else float(value)
    _check_suffix(path, "OpenEXR")
    with atomic_path(path) as temporary:
        try:
            OpenEXR.File(header, channels).write(str(temporary))
        except RuntimeError as error:
            raise _system_error(error) from error


def _system_error(error: RuntimeError) -> Exception:
    """The error of the system in one of OpenEXR, which only has its words."""
    words = str(error)
    if re.search(NO_MEMORY.decode(), words):
        return MemoryError(words)
    number = next((n for n in errno.errorcode if os.strerror(n) in words), errno.EIO)
    return OSError(number, os.strerror(number))


def write_png8(path: str | Path, picture: ArrayLike, *, icc: bytes | None = None) -> None:
    """Write an 8-bit PNG; see :func:`write_png16` for the picture."""
    _write_png(path, _integers(picture, np.uint8), icc)


def write_png16(path: str | Path, picture: ArrayLike, *, icc: bytes | None = None) -> None:
    """Write a 16-bit PNG.

    Parameters
    ----------
    path
        The file to write (replaced atomically).
    picture
        ``(y, x)``, ``(1, y, x)``, ``(3, y, x)`` or ``(y, x, 3)``; if both ends are 3 the first axis
        is the band. Unsigned integers of the file's own type are written as they are; floats are
        0..1 over the full scale, clipped and rounded, with NaN as 0. Normals are stored as
        ``(normal + 1) / 2``.
    icc
        The profile of the display whose codes these are (:func:`impasto.colour.icc_profile`);
        without one, programs take the codes for sRGB.

    Raises
    ------
    ArgumentError
        A picture of another shape or type, or a path that does not end in ``.png``.
    """
    _write_png(path, _integers(picture, np.uint16), icc)


def write_jpeg(
    path: str | Path, picture: ArrayLike, *, quality: int = 92, icc: bytes | None = None
) -> None:
    """Write an 8-bit JPEG with full colour resolution, for viewing.

    Parameters
    ----------
    path
        The file to write (replaced atomically).
    picture
        As for :func:`write_png16`.
    quality
        1 to 100.
    icc
        As for :func:`write_png16`, in segments APP2 as ICC.1:2022, annex B.4, says.
    """
    import cv2

    planes = _integers(picture, np.uint8)
    if len(planes) not in {1, 3}:
        raise ArgumentError(f"picture: a JPEG holds 1 or 3 bands, found {len(planes)}")
    _check_suffix(path, "JPEG")
    pixels = planes[0] if len(planes) == 1 else np.moveaxis(planes[::-1], 0, -1)
    if not (is_whole(quality) and 1 <= quality <= 100):
        raise ArgumentError(f"quality: expected a whole number from 1 to 100, found {quality!r}")
    settings = [cv2.IMWRITE_JPEG_QUALITY, int(quality)]
    settings += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(pixels), settings)
    if not done:
        raise ArgumentError(f"picture: shape {planes.shape} cannot be written as JPEG")
    atomic_bytes(path, _jpeg_with_profile(data.tobytes(), icc))


def write_tiff16(
    path: str | Path,
    picture: ArrayLike,
    *,
    attributes: Mapping[str, Any] | None = None,
    icc: bytes | None = None,
) -> None:
    """Write a 16-bit TIFF (deflate); ``attributes`` become JSON in the image description.

    The picture and ``icc`` are those of :func:`write_png16`, with any number of bands. Three bands
    are stored as RGB pixels, which every program reads; other numbers as one plane per band.
    """
    _write_tiff(path, _integers(picture, np.uint16), attributes, icc)


def write_tiff32(
    path: str | Path, picture: ArrayLike, *, attributes: Mapping[str, Any] | None = None
) -> None:
    """Write a 32-bit float TIFF (deflate): values unchanged, NaN included."""
    array = np.asarray(picture)
    if array.dtype.kind not in "fiub":
        raise ArgumentError(f"picture: expected real numbers, found dtype {array.dtype}")
    _write_tiff(path, _planar(array.astype(np.float32)), attributes)


def _jpeg_with_profile(jpeg: bytes, icc: bytes | None) -> bytes:
    """The profile's segments behind the JFIF header, which must stay the first."""
    if icc is None:
        return jpeg
    start = 4 + int.from_bytes(jpeg[4:6], "big") if jpeg[2:4] == b"\xff\xe0" else 2
    parts = [icc[at : at + _APP2_BYTES] for at in range(0, len(icc), _APP2_BYTES)]
    segments = b"".join(
        b"\xff\xe2"
        + (16 + len(part)).to_bytes(2, "big")
        + b"ICC_PROFILE\0"
        + bytes([number, len(parts)])
        + part
        for number, part in enumerate(parts, 1)
    )
    return jpeg[:start] + segments + jpeg[start:]


def write_json(path: str | Path, content: Any) -> None:
    """Write JSON with sorted keys, UTF-8, LF; NaN and infinity are refused."""
    try:
        text = json.dumps(content, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"content: cannot be written as JSON ({error})") from error
    atomic_bytes(path, (text + "\n").encode("utf-8"))


def _check_suffix(path: str | Path, kind: str) -> None:
    """Refuse a name by which programs would take the file for one of another format."""
    known = _SUFFIXES[kind]
    if Path(path).suffix.lower() not in known:
        raise ArgumentError(
            f"path: this function writes {kind}, expected a name ending in {' or '.join(known)}, "
            f"found {path}"
        )


def _planar(array: NDArray[Any]) -> NDArray[Any]:
    """``(band, y, x)`` from any accepted layout."""
    if array.ndim == 2:
        array = array[None]
    elif array.ndim == 3 and array.shape[2] in {3} and array.shape[0] not in {1, 3}:
        array = np.moveaxis(array, -1, 0)
    if array.ndim != 3 or 0 in array.shape:
        raise ArgumentError(
            f"picture: expected (y, x), (band, y, x) or (y, x, 3), found shape {array.shape}"
        )
    return np.ascontiguousarray(array)


def _integers(picture: ArrayLike, dtype: type[np.unsignedinteger[Any]]) -> NDArray[Any]:
    """Full-scale integers from floats in 0..1; integers of the right type pass."""
    array = np.asarray(picture)
    if array.dtype == dtype:
        return _planar(array)
    if array.dtype == np.bool_:
        array = array.astype(np.float32)
    if array.dtype.kind != "f":
        raise ArgumentError(
            f"picture: expected {np.dtype(dtype).name} or floats from 0 to 1, found {array.dtype}"
        )
    full = float(np.iinfo(dtype).max)
    value = np.nan_to_num(array.astype(np.float64), nan=0.0, posinf=1.0, neginf=0.0)
    return _planar(np.rint(np.clip(value, 0.0, 1.0) * full).astype(dtype))


def _write_png(path: str | Path, planes: NDArray[Any], icc: bytes | None) -> None:
    import cv2

    if len(planes) not in {1, 3}:
        raise ArgumentError(f"picture: a PNG holds 1 or 3 bands, found {len(planes)}")
    _check_suffix(path, "PNG")
    pixels = planes[0] if len(planes) == 1 else np.moveaxis(planes[::-1], 0, -1)
    done, data = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not done:
        raise ArgumentError(f"picture: shape {planes.shape} cannot be written as PNG")
    content = data.tobytes()
    atomic_bytes(path, content if icc is None else _with_profile(content, icc))


def _with_profile(png: bytes, icc: bytes) -> bytes:
    """The PNG with an iCCP chunk after its header, as the format requires."""
    body = b"iCCP" + b"ICC profile\0\0" + zlib.compress(icc, 9)
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    header = 8 + 4 + 4 + 13 + 4
    return png[:header] + chunk + png[header:]


def _write_tiff(
    path: str | Path,
    planes: NDArray[Any],
    attributes: Mapping[str, Any] | None,
    icc: bytes | None = None,
) -> None:
    import tifffile

    _check_suffix(path, "TIFF")
    # JSON escapes keep the description ASCII, as the TIFF tag demands.
    text = json.dumps(dict(attributes), sort_keys=True) if attributes else None
    rgb = len(planes) == 3
    if rgb:
        # OpenCV takes planes of RGB for rows of pixels, without an error.
        stored, layout = np.ascontiguousarray(np.moveaxis(planes, 0, -1)), "contig"
    else:
        stored, layout = planes, "separate"
    single = len(planes) == 1
    with atomic_path(path) as temporary:
        tifffile.imwrite(
            temporary,
            planes[0] if single else stored,
            photometric="rgb" if rgb else "minisblack",
            planarconfig=None if single else layout,
            compression="zlib",
            description=text,
            metadata=None,
            software=False,
            iccprofile=icc,
        )
