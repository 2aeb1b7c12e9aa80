"""What samples are read from: a picture or an array of which any window can be had alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError


class Source(ABC):
    """Samples ``(band, y, x)`` that are read window by window.

    A source holds its file open until :meth:`close`; it is its own context manager. Windows may be
    read from several threads at once.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """The file, for messages."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int, int]:
        """Bands, rows and columns of the whole."""

    @property
    @abstractmethod
    def dtype(self) -> np.dtype[Any]:
        """Of the samples that :meth:`read` returns."""

    @property
    @abstractmethod
    def grid(self) -> tuple[int, int]:
        """Rows and columns of what is decoded at once: a tile, a strip, or the whole picture.

        Windows whose borders lie on multiples of these decode nothing twice.
        """

    def read(self, rows: slice | None = None, columns: slice | None = None) -> NDArray[Any]:
        """The samples of one window; only what it touches is decoded.

        Parameters
        ----------
        rows, columns
            ``slice(first, last + 1)`` inside the picture, without steps; None: all.

        Returns
        -------
        ndarray
            ``(band, rows, columns)``, contiguous, the caller's own.

        Raises
        ------
        ArgumentError
            A window that does not lie inside the picture.
        CorruptInputError
            What the window touches is damaged.
        """
        top, bottom = self._bounds("rows", rows, self.shape[1])
        left, right = self._bounds("columns", columns, self.shape[2])
        return self._read(top, bottom, left, right)

    def read_into(
        self, out: NDArray[Any], rows: slice | None = None, columns: slice | None = None
    ) -> None:
        """The samples of one window, written to where they are wanted: see :meth:`read`.

        Parameters
        ----------
        out
            ``(band, rows, columns)`` of the type of this source; it need not be contiguous.

        Raises
        ------
        ArgumentError
            ``out`` has another shape or type, or what :meth:`read` refuses.
        """
        top, bottom = self._bounds("rows", rows, self.shape[1])
        left, right = self._bounds("columns", columns, self.shape[2])
        wanted = self.shape[0], bottom - top, right - left
        if out.shape != wanted or out.dtype != self.dtype:
            raise ArgumentError(
                f"out: expected {self.dtype} of shape {wanted}, found {out.dtype} of {out.shape}"
            )
        self._read_into(out, top, left)

    def _read_into(self, out: NDArray[Any], top: int, left: int) -> None:
        """The window from ``top`` and ``left`` on, into an array of its size."""
        _, height, width = out.shape
        out[...] = self.read(slice(top, top + height), slice(left, left + width))

    @abstractmethod
    def close(self) -> None:
        """Give the file back; a closed source is not read again."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        bands, height, width = self.shape
        size = f"{bands} bands of {height} rows and {width} columns"
        return f"<{type(self).__name__} {self.name}, {size}, {self.dtype}>"

    @abstractmethod
    def _read(self, top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        """The window of a checked range."""

    def _bounds(self, name: str, wanted: slice | None, size: int) -> tuple[int, int]:
        if wanted is None:
            return 0, size
        first = 0 if wanted.start is None else int(wanted.start)
        end = size if wanted.stop is None else int(wanted.stop)
        if wanted.step not in {None, 1} or not 0 <= first < end <= size:
            raise ArgumentError(
                f"{name}: expected slice(first, end) with 0 <= first < end <= {size}, the size of "
                f"{self.name}; found {wanted}"
            )
        return first, end
