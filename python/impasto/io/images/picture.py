"""Picture files as sources; those that only a whole decoding opens."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import damage_of
from impasto._internal.regular import RegularFile
from impasto.io.images.header import ImageHeader
from impasto.io.sources import Source


class Picture(Source):
    """A picture file.

    Parameters
    ----------
    file
        Closed by the source.
    header
        What the file claims: checked.
    """

    def __init__(self, file: RegularFile, header: ImageHeader) -> None:
        self._file = file
        self.header = header

    @property
    def name(self) -> str:
        """See :class:`~impasto.io.Source`."""
        return str(self.header.path)

    @property
    def dtype(self) -> np.dtype[Any]:
        """float32 for numbers of 64 bits, otherwise the file's."""
        dtype = self.header.dtype
        return np.dtype(np.float32) if dtype == np.float64 else np.dtype(dtype)

    def read(self, rows: slice | None = None, columns: slice | None = None) -> NDArray[Any]:
        """See :class:`~impasto.io.Source`."""
        self.check_open()
        with damage_of(self.header.path, "a picture"):
            return super().read(rows, columns)

    def check_open(self) -> None:
        """Refuse what comes after :meth:`close`."""
        if self._file.handle.closed:
            raise ValueError(f"{self.name}: is closed")

    def close(self) -> None:
        """See :class:`~impasto.io.Source`."""
        self._file.close()


class WholePicture(Picture):
    """A picture that is decoded whole, once, at the first window, and kept until it is closed.

    The rows of a JPEG or PNG can only be decoded after all rows above them.

    Parameters
    ----------
    bands
        How many the decoded picture has.
    decode
        Reads ``(band, y, x)``.
    """

    def __init__(
        self,
        file: RegularFile,
        header: ImageHeader,
        bands: int,
        decode: Callable[[], NDArray[Any]],
    ) -> None:
        super().__init__(file, header)
        self._bands = bands
        self._decode: Callable[[], NDArray[Any]] | None = decode
        self._planes: NDArray[Any] | None = None
        self._first = Lock()

    @property
    def shape(self) -> tuple[int, int, int]:
        """See :class:`~impasto.io.Source`."""
        return self._bands, self.header.height, self.header.width

    @property
    def grid(self) -> tuple[int, int]:
        """The whole picture."""
        return self.header.height, self.header.width

    def close(self) -> None:
        """Forget the decoded picture, too."""
        super().close()
        self._planes = self._decode = None

    def _read(self, top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        with self._first:
            if self._planes is None:
                if self._decode is None:
                    raise ValueError(f"{self.name}: is closed")
                self._planes = self._decode()
        return np.array(self._planes[:, top:bottom, left:right], order="C")
