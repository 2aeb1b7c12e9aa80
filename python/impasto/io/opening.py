"""Any file of samples as a source of windows."""

from __future__ import annotations

from pathlib import Path

from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError
from impasto.io.arrays import MAGIC, open_array, open_member
from impasto.io.images import MAX_PIXELS, open_picture
from impasto.io.session.stored import SUFFIX, StoredObservation
from impasto.io.sources import Source


def open_source(
    path: str | Path,
    *,
    layer: str | None = None,
    member: str | None = None,
    index: int | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Source:
    """Open a file of which any window can be read without decoding the rest.

    ====================  ===========================================================
    file                  what a window costs
    ====================  ===========================================================
    TIFF, BigTIFF         the strips or tiles that it touches; without compression the
                          pixels alone
    OpenEXR               the tiles or blocks of rows that it touches, all channels of
                          the parts that hold the layer
    ``.npy``, ``.npz``    its values alone (``.npz`` of ``numpy.savez``)
    JPEG, PNG             one decoding of the whole, which the source keeps
    ``.zarr``             the chunks that it touches, with all observations
    ====================  ===========================================================

    Parameters
    ----------
    path
        A picture as :func:`read_image` reads it, or an array ``(band, y, x)`` or ``(y, x)``.
    layer
        Of OpenEXR files with several.
    member
        The name of the array in an ``.npz``; default: ``samples``, as in :func:`write_stack`.
    index
        The observation of an array ``(obs, band, y, x)`` in an ``.npz`` or of a ``.zarr``.
    max_pixels
        Larger pictures are refused.

    Returns
    -------
    Source
        With ``shape``, ``dtype``, ``grid``, ``read(rows, columns)`` and ``close()``.

    Raises
    ------
    CorruptInputError
        Truncated, damaged or nothing that can be read.
    ArgumentError
        Not found, no file, too large, or a layer or array that is not there.

    Examples
    --------
    >>> with impasto.io.open_source("photo.tif") as source:      # doctest: +SKIP
    ...     tile = source.read(slice(0, 512), slice(1024, 1536))
    """
    if Path(path).suffix.lower() == SUFFIX and Path(path).is_dir():
        return StoredObservation(Path(path), 0 if index is None else index)
    file = RegularFile(Path(path))
    try:
        first = file.at(0, min(6, file.size))
        archived = first.startswith(b"PK")
        if not archived and (member is not None or index is not None):
            raise ArgumentError(f"member, index: {path} is no .npz, which alone has them")
        if archived:
            return open_member(file, "samples" if member is None else member, index)
        if first == MAGIC:
            return open_array(file)
    except BaseException:
        file.close()
        raise
    file.close()
    return open_picture(path, layer=layer, max_pixels=max_pixels)
