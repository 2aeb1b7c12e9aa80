"""Moving pictures: animated PNG, GIF through Pillow, MP4 (H.264) through a separate ffmpeg."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.extras import need
from impasto.errors import ArgumentError
from impasto.io.files import atomic_path

Codes = NDArray[np.uint8]
FilmFormat = Literal["PNG", "GIF", "MP4"]

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
FORMATS: dict[str, FilmFormat] = {".png": "PNG", ".apng": "PNG", ".gif": "GIF", ".mp4": "MP4"}
"""Formats by suffix."""
SLOWEST, FASTEST = 0.01, 500.0
"""Frames per second that every format can tell."""
GIF_FASTEST = 50.0
"""Frames per second; a GIF counts hundredths of a second, and programs slow down below two."""
H264 = " ".join(
    (
        # Deterministic, close to lossless for the eye, and playable before it is loaded completely.
        "-crf 16 -preset medium -threads 1 -movflags +faststart",
        "-fflags +bitexact -flags:v +bitexact -map_metadata -1",
        # Codes are those of sRGB: BT.709 primaries.
        "-vf scale=out_color_matrix=bt709:out_range=tv",
        "-colorspace bt709 -color_primaries bt709 -color_trc iec61966-2-1",
    )
).split()
"""Options of ffmpeg."""


def film_format(path: str | Path, name: str = "path") -> FilmFormat:
    """The format that a suffix selects; what it needs is installed.

    Raises
    ------
    ArgumentError
        Another suffix.
    MissingExtraError
        Pillow or imageio-ffmpeg is not installed.
    """
    chosen = FORMATS.get(Path(path).suffix.lower())
    if chosen is None:
        raise ArgumentError(
            f"{name}: expected a name ending in .png, .gif or .mp4, or a folder, found {path}"
        )
    if chosen != "PNG":
        need("imageio_ffmpeg" if chosen == "MP4" else "PIL", "video", f"a film in {chosen}")
    return chosen


def write_film(
    path: str | Path, frames: Iterable[Codes], *, fps: float = 12.0, icc: bytes | None = None
) -> None:
    """Write display codes as a film that repeats; the file appears when it is complete.

    Parameters
    ----------
    path
        ``.png`` or ``.apng``: animated PNG, exact; ``.gif``: 256 colours per frame; ``.mp4``:
        H.264, a row or column repeated where a size is odd.
    frames
        ``(y, x, 3)`` uint8 each, all of one size.
    fps
        Frames per second.
    icc
        The profile of the display whose codes these are, for animated PNG; GIF and MP4 take codes
        of sRGB.

    Raises
    ------
    ArgumentError
        Another suffix, no frame, frames of different sizes.
    MissingExtraError
        Pillow or imageio-ffmpeg is not installed (``pip install 'impasto[video]'``).
    """
    chosen = film_format(path)
    most = GIF_FASTEST if chosen == "GIF" else FASTEST
    if not SLOWEST <= fps <= most:
        raise ArgumentError(f"fps: expected {SLOWEST:g} to {most:g} in {chosen}, found {fps:g}")
    checked = _same_size(frames)
    first = next(checked, None)
    if first is None:
        raise ArgumentError("frames: expected at least one, found none")
    with atomic_path(path) as temporary:
        if chosen == "MP4":
            _mp4(temporary, first, checked, fps)
        elif chosen == "GIF":
            _gif(temporary, first, checked, fps)
        else:
            _animated_png(temporary, first, checked, fps, icc)


def _same_size(frames: Iterable[Codes]) -> Iterator[Codes]:
    size: tuple[int, ...] | None = None
    for number, frame in enumerate(frames):
        codes = np.ascontiguousarray(frame)
        if codes.dtype != np.uint8 or codes.ndim != 3 or codes.shape[2] != 3:
            raise ArgumentError(
                f"frames: expected (y, x, 3) uint8, found {codes.dtype} {codes.shape}"
            )
        if size is not None and codes.shape != size:
            raise ArgumentError(
                f"frames: frame {number} is {codes.shape[:2]}, the first is {size[:2]}"
            )
        size = codes.shape
        yield codes


def _gif(path: Path, first: Codes, others: Iterator[Codes], fps: float) -> None:
    from PIL import Image

    def picture(codes: Codes) -> Image.Image:
        return Image.fromarray(codes).quantize(256)

    with path.open("wb") as file:
        picture(first).save(
            file,
            format="GIF",
            save_all=True,
            append_images=(picture(codes) for codes in others),
            duration=1000.0 / fps,
            loop=0,
        )


def _animated_png(
    path: Path, first: Codes, others: Iterator[Codes], fps: float, icc: bytes | None
) -> None:
    """Whole frames one after another, as the third edition of the PNG specification says.

    Pillow would hold all frames in memory, and leave out those that equal the one before.
    """
    number = 0
    with path.open("wb") as file:
        for frame, codes in enumerate(chain([first], others)):
            chunks = _png_chunks(codes)
            if frame == 0:
                file.write(PNG_SIGNATURE + _chunk(b"IHDR", chunks[b"IHDR"]))
                if icc is not None:
                    file.write(_chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(icc, 9)))
                counted_at = file.tell()
                file.write(_chunk(b"acTL", bytes(8)))
            height, width, _ = codes.shape
            delay = (100, round(100.0 * fps)) if fps > 1.0 else (round(100.0 / fps), 100)
            control = struct.pack(">5I2H2B", number, width, height, 0, 0, *delay, 0, 0)
            file.write(_chunk(b"fcTL", control))
            number += 1
            if frame == 0:
                file.write(_chunk(b"IDAT", chunks[b"IDAT"]))
            else:
                file.write(_chunk(b"fdAT", struct.pack(">I", number) + chunks[b"IDAT"]))
                number += 1
        file.write(_chunk(b"IEND", b""))
        file.seek(counted_at)
        file.write(_chunk(b"acTL", struct.pack(">2I", frame + 1, 0)))


def _png_chunks(codes: Codes) -> dict[bytes, bytes]:
    """The contents of the chunks of a PNG; those of one kind are joined."""
    import cv2

    done, data = cv2.imencode(".png", np.ascontiguousarray(codes[..., ::-1]))
    if not done:
        raise ArgumentError(f"frames: shape {codes.shape} cannot be written as PNG")
    content, at = data.tobytes(), len(PNG_SIGNATURE)
    found: dict[bytes, bytes] = {}
    while at < len(content):
        (size,) = struct.unpack_from(">I", content, at)
        kind = content[at + 4 : at + 8]
        found[kind] = found.get(kind, b"") + content[at + 8 : at + 8 + size]
        at += 12 + size
    return found


def _chunk(kind: bytes, content: bytes) -> bytes:
    return (
        struct.pack(">I", len(content))
        + kind
        + content
        + struct.pack(">I", zlib.crc32(kind + content))
    )


def _mp4(path: Path, first: Codes, others: Iterator[Codes], fps: float) -> None:
    import imageio_ffmpeg

    def even(codes: Codes) -> Codes:
        return np.pad(codes, [(0, size % 2) for size in codes.shape[:2]] + [(0, 0)], mode="edge")

    height, width, _ = even(first).shape
    writer = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=fps,
        codec="libx264",
        quality=None,
        macro_block_size=2,
        ffmpeg_log_level="error",
        output_params=H264,
    )
    try:
        writer.send(None)
        writer.send(even(first))
        for codes in others:
            writer.send(even(codes))
    finally:
        writer.close()
