"""What a camera has written about a photograph (EXIF 2.32): camera, lens, exposure and time.

An EXIF block is a TIFF file without a picture, whose tags tifffile reads. Where LibRaw is
installed (the extra ``raw``), it states the exposure of RAW files that are no TIFF.
"""

from __future__ import annotations

import io
import logging
import math
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from impasto._internal.regular import RegularFile
from impasto.errors import CorruptInputError
from impasto.io.images.raw import RAW_SUFFIXES

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG_START = 1 << 20
"""Bytes at the beginning of a JPEG in which its EXIF block lies; segments have at most 64 KiB."""
_TIME = "%Y:%m:%d %H:%M:%S"
_FIRST_YEAR = 1990
"""No digital camera is older."""
_SILENT = logging.NullHandler()
DIAGONAL_MM = math.hypot(36.0, 24.0)
"""Of the film to which ``FocalLengthIn35mmFilm`` refers."""


@dataclass(frozen=True, slots=True)
class Exif:
    """What is known of a photograph; None: not stated.

    Parameters
    ----------
    camera
        Maker and model.
    focal_length_mm, film_focal_length_mm
        Of the lens; and of a lens with the same field of view on film of 36 x 24 mm.
    exposure_s, f_number, iso
        Exposure time in seconds, f-number and sensitivity.
    taken
        When; the clock of the camera, without a time zone.
    """

    camera: str | None = None
    focal_length_mm: float | None = None
    film_focal_length_mm: float | None = None
    exposure_s: float | None = None
    f_number: float | None = None
    iso: float | None = None
    taken: datetime | None = None

    def focal_length_px(self, width: int, height: int) -> float | None:
        """The focal length in pixels of a whole frame of so many columns and rows.

        By the diagonal, as EXIF defines ``FocalLengthIn35mmFilm`` for frames of any shape.
        """
        if self.film_focal_length_mm is None:
            return None
        return self.film_focal_length_mm / DIAGONAL_MM * math.hypot(width, height)


def read_exif(path: str | Path) -> Exif:
    """What the camera has written into a photograph.

    Nothing is decoded, and damage of the block is no error: it does not affect the pixels.

    Parameters
    ----------
    path
        JPEG, PNG, TIFF or RAW; other files state nothing.

    Raises
    ------
    ArgumentError
        The file cannot be read.
    """
    path = Path(path)
    with closing(RegularFile(path)) as file:
        tags: dict[str, Any] = {}
        with suppress(CorruptInputError):  # cut off
            block = _block(file)
            tags = {} if block is None else _tags(block)
        if "ExposureTime" not in tags and path.suffix.lower() in RAW_SUFFIXES:
            tags |= _tags_of_libraw(file)
    maker, model = (_words(tags.get(name)) for name in ("Make", "Model"))
    if maker and model and model.casefold().startswith(maker.split()[0].casefold()):
        maker = ""
    return Exif(
        " ".join(word for word in (maker, model) if word) or None,
        _positive(tags.get("FocalLength")),
        _positive(tags.get("FocalLengthIn35mmFilm")),
        _positive(tags.get("ExposureTime")),
        _positive(tags.get("FNumber")),
        _positive(tags.get("ISOSpeedRatings")),
        _taken(tags),
    )


def _block(file: RegularFile) -> io.IOBase | None:
    """The EXIF block, or a file that is TIFF itself; None where there is none."""
    start = file.at(0, min(file.size, _JPEG_START))
    if start[:2] in {b"II", b"MM"}:
        return file.handle
    block = b""
    if start.startswith(b"\xff\xd8"):
        block = _of_jpeg(start)
    elif start.startswith(_PNG):
        block = _of_png(file)
    return io.BytesIO(block) if block else None


def _of_jpeg(data: bytes) -> bytes:
    at = 2
    while data[at : at + 1] == b"\xff" and data[at + 1] != 0xDA:
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            return data[at + 10 : at + 2 + length]
        if length < 2:
            break
        at += 2 + length
    return b""


def _of_png(file: RegularFile) -> bytes:
    at = len(_PNG)
    while at + 8 <= file.size:
        head = file.at(at, 8)
        length = int.from_bytes(head[:4], "big")
        if head[4:] == b"eXIf":
            return file.at(at + 8, length)
        at += 12 + length
    return b""


def _tags(block: io.IOBase) -> dict[str, Any]:
    """The tags of the first directory and of its EXIF directory."""
    import tifffile

    # It would say on the terminal that there is no picture.
    logging.getLogger("tifffile").addHandler(_SILENT)
    try:
        opened = tifffile.TiffFile(block, offset=0)
        tags = {tag.name: tag.value for tag in opened.pages.first.aspage().tags}
    except MemoryError:
        raise
    except Exception:  # tifffile raises many kinds of exceptions
        return {}
    own = tags.get("ExifTag")
    return tags | own if isinstance(own, dict) else tags


def _tags_of_libraw(file: RegularFile) -> dict[str, Any]:
    try:
        import rawpy
    except ImportError:
        return {}
    with suppress(rawpy.LibRawError), rawpy.imread(io.BytesIO(file.content())) as raw:
        other = getattr(raw, "other", None)  # of later versions
        if other is not None:
            found = {
                "ExposureTime": other.shutter_speed,
                "FNumber": other.aperture,
                "ISOSpeedRatings": other.iso_speed,
                "FocalLength": other.focal_length,
            }
            # 1970 where the file does not say.
            known = other.timestamp.year >= _FIRST_YEAR
            return found | ({"DateTime": other.timestamp.strftime(_TIME)} if known else {})
    return {}


def _taken(tags: dict[str, Any]) -> datetime | None:
    for name, part in (("DateTimeOriginal", "SubsecTimeOriginal"), ("DateTime", "SubsecTime")):
        with suppress(ValueError):
            found = datetime.strptime(_words(tags.get(name)), _TIME)
            digits = _words(tags.get(part))
            if digits.isdecimal() and digits.isascii():
                found = found.replace(microsecond=int(digits[:6].ljust(6, "0")))
            return found
    return None


def _words(value: Any) -> str:
    return value.strip("\0 ") if isinstance(value, str) else ""


def _positive(value: Any) -> float | None:
    """A number, or a fraction of two."""
    try:
        if isinstance(value, tuple):
            found = float(value[0]) / float(value[1]) if len(value) == 2 else float(value[0])
        else:
            found = float(value)
    except (ArithmeticError, LookupError, TypeError, ValueError):
        return None
    return found if math.isfinite(found) and found > 0 else None
