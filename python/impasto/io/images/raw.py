"""RAW files of cameras, developed by LibRaw: linear, neither balanced, sharpened nor denoised.

The level of black is taken off, the level of white becomes the largest code; both are what the file
states, and never depend on what the photograph shows. Colours stay those of the camera.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.extras import need
from impasto._internal.regular import RegularFile
from impasto.errors import CorruptInputError
from impasto.io.images.header import ImageHeader
from impasto.io.images.native_stderr import captured_lines
from impasto.io.images.picture import WholePicture

RAW_SUFFIXES = frozenset(
    {".3fr", ".arw", ".cr2", ".cr3", ".dng", ".erf", ".fff", ".iiq", ".kdc", ".mef", ".mos"}
    | {".mrw", ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2", ".srw"}
)
DEMOSAICING = "VNG"
"""Variable number of gradients (Chang, Cheung and Pang 1999): of seven the best normals, or within
1 % of them (``benches/python/demosaicing.py``). DHT has better colours, but puts the darkest code
above black in the place of black ones."""
_ORIENTATION = {0: 1, 3: 3, 5: 8, 6: 6}
"""EXIF orientations by the turns that LibRaw names."""
_DAMAGE_OF_RAW = rb"Unexpected end of file|data corrupted|[Cc]orrupt|Decoding error"


def open_raw(file: RegularFile) -> WholePicture:
    """A RAW file as a source; its header is read, its pixels are not.

    Raises
    ------
    CorruptInputError
        LibRaw does not know the file, or it has colours other than red, green and blue.
    MissingExtraError
        rawpy is not installed.
    """
    need("rawpy", "raw", f"{file.path}, a RAW file of a camera,")
    data = file.content()
    with _opened(file.path, data) as raw:
        sizes, colours, names = raw.sizes, raw.num_colors, raw.color_desc
    if colours not in {1, 3} or (colours == 3 and set(names[:3]) != set(b"RGB")):
        raise CorruptInputError(
            file.path,
            f"has the colours {names.decode('ascii', 'replace')}, which cannot be developed: "
            "convert it to linear 16-bit TIFF",
        )
    # Turned photographs are decoded as they lie on the sensor; their size is given turned.
    size = (sizes.width, sizes.height)
    orientation = _ORIENTATION.get(sizes.flip, 1)
    header = ImageHeader(
        file.path, "raw", *size, colours, np.dtype(np.uint16), orientation, "linear"
    )
    return WholePicture(file, header, colours, partial(_developed, header, data))


def _developed(header: ImageHeader, data: bytes) -> NDArray[np.uint16]:
    """``(band, y, x)`` of the whole picture."""
    import rawpy

    with _opened(header.path, data) as raw:
        planes = raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm[DEMOSAICING],
            output_color=rawpy.ColorSpace.raw,
            output_bps=16,
            gamma=(1.0, 1.0),
            user_wb=[1.0, 1.0, 1.0, 1.0],
            user_flip=0,
            no_auto_bright=True,
            # The level of white of the file: not the largest code of this photograph.
            adjust_maximum_thr=0.0,
            highlight_mode=rawpy.HighlightMode.Clip,
        )
    found = np.asarray(planes).reshape(*planes.shape[:2], -1)
    if found.shape != (header.height, header.width, header.channels):
        raise CorruptInputError(
            header.path,
            f"is damaged: the header says {header.width} x {header.height} pixels in "
            f"{header.channels} colours, {found.shape[1]} x {found.shape[0]} in "
            f"{found.shape[2]} were found",
        )
    return np.moveaxis(found, -1, 0)


@contextmanager
def _opened(path: Path, data: bytes) -> Iterator[Any]:
    """A file of LibRaw; what goes wrong in the block is damage of it.

    LibRaw decodes what it can of a damaged file, and says the rest on stderr only.
    """
    import rawpy

    try:
        with captured_lines(_DAMAGE_OF_RAW) as said, rawpy.imread(io.BytesIO(data)) as raw:
            yield raw
    except (MemoryError, CorruptInputError):
        raise
    except rawpy.LibRawError as error:
        if isinstance(error, rawpy.LibRawUnsufficientMemoryError):
            raise MemoryError(f"{path}: {error}") from error
        words = error.args[0] if error.args else "an error of LibRaw"
        problem = words.decode("utf-8", "replace") if isinstance(words, bytes) else str(words)
        raise CorruptInputError(
            path, f"cannot be developed by LibRaw ({problem}); copy it again from the camera"
        ) from error
    if said:
        raise CorruptInputError(path, f"is damaged ({said[0]}); copy it again from the camera")
