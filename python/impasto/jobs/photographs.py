"""The photographs of a job: windows of them, read when a tile needs them."""

from __future__ import annotations

import hashlib
import json
import math
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import suggestion
from impasto._internal.recycling import Recycled, recycling
from impasto._internal.windows import Window, offset
from impasto.encoding import Encoding
from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.fit.deferred import Deferred
from impasto.fit.subsample import Sample
from impasto.io.files import as_problem_of
from impasto.io.images import open_picture
from impasto.io.npz import read_npz
from impasto.io.opening import open_source
from impasto.io.rig_arrays import arrays_of_rig
from impasto.io.session.frames import picture_codes
from impasto.io.session.from_session import SessionPhotographs
from impasto.io.session.reader import read_stack
from impasto.io.session.stored import SUFFIX, StoredStack, thinned_stored
from impasto.io.session_toml import is_session
from impasto.io.sources import Source
from impasto.jobs.grid import Footprint
from impasto.report import file_entries, file_entry
from impasto.rig import Rig
from impasto.stack import Stack

MIDDLE = 1024
"""Rows and columns in the middle of the photographs from which their tone curve is taken, if it is
not given and the whole is not read."""
FINISHED = {".npz", ".zarr"}
"""Suffixes of what holds a finished stack, not photographs."""
READING = (
    "lights", "images", "encoding", "mask", "saturation", "white", "dark", "board_reflectance",
    "intensities", "pattern", "bands", "pitch_mm", "layer", "strict", "max_pixels",
)  # fmt: skip
"""Options of :func:`impasto.read_stack` that a job takes."""
ROWS = 256
"""Rows of a mask that are counted at a time."""
CHUNK = 1 << 24
"""Bytes of a stack in memory that are hashed at a time."""


class Photographs(ABC):
    """Photographs of one painting of which windows can be had one after another.

    A source of another kind is a class with these members, and goes to :func:`impasto.run` and
    :func:`impasto.ingest` in place of a path.
    """

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int, int, int]:
        """Observations, bands, rows and columns."""

    @property
    @abstractmethod
    def pixel(self) -> Footprint:
        """What a pixel takes."""

    @property
    @abstractmethod
    def source_grid(self) -> tuple[int, int]:
        """Rows and columns of what is decoded at once."""

    @property
    @abstractmethod
    def encoding(self) -> Encoding:
        """Their tone curve."""

    @property
    @abstractmethod
    def notes(self) -> list[list[str]]:
        """Kind and text of what was repaired, left out or assumed while they were read."""

    @abstractmethod
    def inputs(self) -> list[dict[str, Any]]:
        """Name, size and SHA-256 of what is read; all of it is read for this.

        Returns
        -------
        list
            A dictionary for each file: ``file``, its absolute path, or words for what is no file;
            ``bytes``, its size; and ``sha256``, in hexadecimal digits. Of a tile of a store, whose
            readers compare its checksums, ``crc32c``, one of these, in place of ``sha256``. Other
            keys are kept in the record.
        """

    def hashed(self, report: Callable[[int, int], object]) -> list[dict[str, Any]]:
        """What :meth:`inputs` returns, and on the way how many bytes of how many are read.

        It is called from another thread than the rest, and ended by an error of ``report``.
        """
        report(0, 0)
        return self.inputs()

    def changed(self, window: Window | None = None) -> list[Path]:
        """Files whose content is another than when they were opened, after they were hashed.

        With a window those from which it is read, if that are few: a store has a file for every
        tile.

        A file of which only date or number have changed is hashed again. Where that happened
        before it was hashed, nobody knows what it held: it counts as changed.
        """
        return []

    @abstractmethod
    def window(self, rows: slice, columns: slice) -> Stack:
        """The photographs of a window; the stack knows where it lies (``rig.origin``).

        There is a mask in all windows, or in none. It is called from another thread than the rest.
        """

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.shape[2], self.shape[3]

    def whole(self) -> Stack:
        """All photographs at once."""
        rows, columns = self.size
        return self.window(slice(0, rows), slice(0, columns))

    def inside(self, sample: Sample) -> int:
        """How many pixels of a sample lie within the mask."""
        return sample.count(None)

    def thinned(self, rows: slice, columns: slice, stride: int) -> Stack:
        """Every so many rows and columns of a window, from its first on."""
        part = self.window(rows, columns)
        every = np.s_[..., ::stride, ::stride]
        mask = None if part.mask is None else part.mask[every]
        return part._replace(samples=part.samples[every], mask=mask)

    def sampled(self, sample: Sample, side: int) -> Stack:
        """A sample of all photographs.

        Windows of ``side`` rows and columns, as tiles of that size lie, are read one after another.
        """
        if (stride := sample.stride) == 1:
            return self.whole()
        rows, columns = (range(n)[i] for n, i in zip(self.size, sample.window, strict=True))
        found: NDArray[Any] | None = None
        mask = np.ones((len(rows), len(columns)), np.bool_)
        first: Stack | None = None
        memory = Recycled()
        for down in _between_multiples(rows, side):
            for across in _between_multiples(columns, side):
                lines, places = rows[down], columns[across]
                area = slice(lines[0], lines[-1] + 1), slice(places[0], places[-1] + 1)
                with recycling(memory):
                    part = self.thinned(*area, stride)
                if first is None:
                    # All that it is but its pixels, whose memory the next window takes.
                    first = part._replace(samples=part.samples[..., :1, :1].copy(), mask=None)
                if found is None:
                    found = np.empty((*self.shape[:2], *mask.shape), part.samples.dtype)
                found[..., down, across] = part.samples
                if part.mask is not None:
                    mask[down, across] = part.mask
                del part
        assert first is not None
        assert found is not None
        rig = sample.rig(Rig(first.rig, origin=(0.0, 0.0)))
        return first._replace(samples=found, rig=rig, mask=None if mask.all() else mask)


class StackInMemory(Photographs):
    """A stack, whose samples may be a memory map."""

    def __init__(self, stack: Stack) -> None:
        if stack.rig.origin != (0.0, 0.0):
            raise ArgumentError(
                "source: a job fits a whole painting, this stack is a part of one (rig.origin)"
            )
        self.stack = stack

    @property
    def shape(self) -> tuple[int, int, int, int]:  # noqa: D102
        return self.stack.shape

    @property
    def pixel(self) -> Footprint:  # noqa: D102
        observations, bands = self.shape[:2]
        samples = observations * bands * self.stack.samples.dtype.itemsize
        held = 0 if _mapped(self.stack.samples) else samples
        return Footprint(samples, 0, observations, bands, held)

    @property
    def source_grid(self) -> tuple[int, int]:  # noqa: D102
        return 1, 1

    @property
    def encoding(self) -> Encoding:  # noqa: D102
        return self.stack.encoding

    @property
    def notes(self) -> list[list[str]]:  # noqa: D102
        return _in_plain(self.stack.notes)

    def inputs(self) -> list[dict[str, Any]]:
        """The samples, and everything else that a fit takes from the stack."""
        return self.hashed(lambda done, total: None)

    def hashed(self, report: Callable[[int, int], object]) -> list[dict[str, Any]]:  # noqa: D102
        stack, digest = self.stack, hashlib.sha256()
        flat = stack.samples.reshape(-1).view(np.uint8)
        for start in range(0, flat.size, CHUNK):
            report(start, flat.size)
            digest.update(np.ascontiguousarray(flat[start : start + CHUNK]).data)
        others: dict[str, Any] = {
            **arrays_of_rig(stack.rig), "bands": np.array(stack.bands), "scale": stack.scale,
            "black": stack.black, "mask": stack.mask, "saturation": stack.saturation,
        }  # fmt: skip
        for name, array in sorted(others.items()):
            if array is not None:
                shape = json.dumps([name, array.dtype.str, array.shape])
                digest.update(shape.encode() + np.ascontiguousarray(array).tobytes())
        entry = {"dtype": str(stack.samples.dtype), "bytes": stack.samples.nbytes}
        return [{"file": "a stack in memory", **entry, "sha256": digest.hexdigest()}]

    def inside(self, sample: Sample) -> int:  # noqa: D102
        return sample.count(self.stack.mask)

    def window(self, rows: slice, columns: slice) -> Stack:  # noqa: D102
        height, width = self.size
        if (rows, columns) == (slice(0, height), slice(0, width)):
            return self.stack
        return self.stack[rows, columns]


class Files(Photographs):
    """What :func:`impasto.read_stack` reads, window by window, or once if there is room for it."""

    def __init__(
        self, path: Path, reading: Mapping[str, Any], memory: int, encoding: Encoding | None
    ) -> None:
        self._path = path
        self._session = SessionPhotographs.verified(path, reading) if is_session(path) else None
        if self._session is not None:
            reading = self._session.arguments
            if "region" in reading:
                place = self._session.session.place("photographs.region")
                raise ArgumentError(f"{place}: a job fits the whole painting; remove the line")
        self._reading = dict(reading)
        # A finished stack takes no mask, and says so.
        finished = path.suffix.lower() in FINISHED
        self._mask = None if finished else self._reading.pop("mask", None)
        one = self._stack_of((0, 0, 1, 1))
        with self._any_picture(one, reading) as picture:
            size = picture.shape[1:]
            self._grid = picture.grid
            codes = picture.dtype.itemsize
        # That of the whole painting: a region of files has the world's origin in its own middle.
        self._rig = self._stack_of(_middle(size, (1, 1))).rig.here
        self._store = StoredStack(path.absolute()) if path.suffix.lower() == SUFFIX else None
        sources = one.sources if self._store is None else tuple(self._store.files())
        self._notes = _in_plain(one.notes)
        observations, bands = one.shape[:2]
        self._shape = (observations, bands, *size)
        samples = one.samples.dtype.itemsize
        each = observations * bands
        self._pixel = Footprint(each * samples, each * codes, observations, bands)
        if self._mask is not None:
            with open_picture(self._mask) as picture:
                if picture.shape[1:] != size:
                    raise ArgumentError(
                        f"mask: {self._mask} has {picture.shape[1:]} pixels, the photographs {size}"
                    )
            sources = (*sources, Path(self._mask))
        paths = dict.fromkeys(path.absolute() for path in sources)
        # Before any pixel that counts is read, and before the hashes.
        self._seen = {path: _trace(path) for path in paths}
        self._hashes: dict[Path, dict[str, Any]] = {}
        self._stack: Stack | None = None
        # Rows that are decoded across the whole picture are kept for the tiles beside each other.
        decoded = math.prod(self._grid) * bands * codes
        row = size[1] * (self._pixel.samples + self._pixel.codes)
        self._rows = max(memory - decoded, 0) // row if self._grid[1] >= size[1] else 0
        self._band: tuple[slice, Stack] | None = None
        self._reading_band = Lock()
        if size[0] * size[1] * self._pixel.learned <= memory:
            self._stack = self._read(None, encoding)
            self._encoding = self._stack.encoding
        elif encoding is not None:
            self._encoding = encoding
        elif reading.get("encoding") not in {None, "auto"}:
            self._encoding = one.encoding
        else:
            self._encoding = self._read(_middle(size, (MIDDLE, MIDDLE))).encoding

    @property
    def shape(self) -> tuple[int, int, int, int]:  # noqa: D102
        return self._shape

    @property
    def pixel(self) -> Footprint:  # noqa: D102
        return self._pixel

    @property
    def source_grid(self) -> tuple[int, int]:  # noqa: D102
        return self._grid

    @property
    def encoding(self) -> Encoding:  # noqa: D102
        return self._encoding

    @property
    def notes(self) -> list[list[str]]:  # noqa: D102
        return self._notes

    def inputs(self) -> list[dict[str, Any]]:  # noqa: D102
        return self.hashed(lambda done, total: None)

    def hashed(self, report: Callable[[int, int], object]) -> list[dict[str, Any]]:  # noqa: D102
        if self._store is None:
            return file_entries(list(self._seen), report, self._keep)
        found: list[dict[str, Any]] = []
        total = sum(path.stat().st_size for path in self._seen)
        for path in self._seen:
            report(sum(one["bytes"] for one in found), total)
            found.append(self._store.tile_entry(path) or file_entry(path))
            self._keep(path, found[-1])
        return found

    def changed(self, window: Window | None = None) -> list[Path]:  # noqa: D102
        found = []
        for path in list(self._seen) if self._store is None else self._store.files(window):
            if (now := _trace(path)) == self._seen[path]:
                continue
            if self._is_other(path):
                found.append(path)
            else:
                self._seen[path] = now  # read again once for every date
        return found

    def _keep(self, path: Path, entry: dict[str, Any]) -> None:
        """Keep the hash of a file that was still the one that was opened when it was hashed."""
        if _trace(path) == self._seen[path]:
            self._hashes[path] = entry

    def _is_other(self, path: Path) -> bool:
        """Whether the content of a file has changed; all of it is read where its size has not."""
        known = self._hashes.get(path)
        if known is None or (known["bytes"],) != _trace(path)[:1]:
            return True
        try:
            with as_problem_of(path):
                return self._read_again(path) != known
        except CorruptInputError:
            return True

    def _read_again(self, path: Path) -> dict[str, Any]:
        """Name, size and hash of a file; of a tile of a store its checksum, that of its numbers."""
        if self._store is None:
            return file_entry(path)
        return self._store.tile_entry(path, compare=True) or file_entry(path)

    def inside(self, sample: Sample) -> int:  # noqa: D102
        if self._stack is not None:
            return sample.count(self._stack.mask)
        height, width = self.size
        if self._masked((0, 0, 1, 1)) is None:
            return super().inside(sample)
        rows, columns = sample.window
        count = 0
        for top in range(rows.start, height, sample.stride * ROWS):
            there = self._masked((top, 0, min(sample.stride * ROWS, height - top), width))
            assert there is not None
            count += int(np.count_nonzero(there[:: sample.stride, columns]))
        return count

    def window(self, rows: slice, columns: slice) -> Stack:  # noqa: D102
        if self._stack is not None:
            return StackInMemory(self._stack).window(rows, columns)
        if self._rows > rows.stop - rows.start:
            with self._reading_band:
                return self._banded(rows, columns)
        region = (rows.start, columns.start, rows.stop - rows.start, columns.stop - columns.start)
        return self._read(region, self._encoding)

    def thinned(self, rows: slice, columns: slice, stride: int) -> Stack:  # noqa: D102
        if self._stack is not None or self._store is None:
            return super().thinned(rows, columns, stride)
        return thinned_stored(self._path, (rows, columns), stride)

    def _banded(self, rows: slice, columns: slice) -> Stack:
        """A window of a band of whole rows, as high as fits, which is read for many windows."""
        band = self._band
        if band is None or not band[0].start <= rows.start < rows.stop <= band[0].stop:
            self._band = None  # before the next one is there
            height, width = self.size
            kept = slice(rows.start, min(rows.start + self._rows, height))
            stack = self._read((kept.start, 0, kept.stop - kept.start, width), self._encoding)
            band = self._band = kept, stack
        within = slice(rows.start - band[0].start, rows.stop - band[0].start)
        return band[1][within, columns]

    def _read(
        self, region: tuple[int, int, int, int] | None, encoding: Encoding | None = None
    ) -> Stack:
        """A region, or all, with the mask, of which a region may lie outside."""
        finished = self._path.suffix.lower() in FINISHED
        changes = {} if encoding is None or finished else {"encoding": encoding}
        stack = self._stack_of(region, **changes)
        if region is not None:
            top, left, height, width = region
            window = slice(top, top + height), slice(left, left + width)
            stack = stack._replace(rig=self._rig.part(*offset(window, self.size)))
        if self._mask is None:
            return stack
        return stack._replace(mask=self._masked(region))

    def _any_picture(self, stack: Stack, reading: Mapping[str, Any]) -> Source:
        """One of the photographs, open; all are of one size and type."""
        session = self._session
        if session is None or session.geometry is None:
            return _any_picture(self._path, stack, reading)
        return session.geometry.open(session.files()[0][0], reading.get("layer"))

    def _stack_of(self, region: tuple[int, int, int, int] | None, **changes: Any) -> Stack:
        """What is read of a region, or of all, without the mask."""
        if self._session is not None:
            return self._session.read(region=region, mask=None, **changes)
        return read_stack(self._path, region=region, **{**self._reading, **changes})

    def _masked(self, region: tuple[int, int, int, int] | None) -> NDArray[np.bool_] | None:
        """The mask of a region, or all of it; None where there is none."""
        top, left, height, width = region or (0, 0, *self.size)
        rows, columns = slice(top, top + height), slice(left, left + width)
        if self._store is not None:
            return self._store.mask(rows, columns)
        mask = self._whole_mask
        return None if mask is None else mask[rows, columns]

    @cached_property
    def _whole_mask(self) -> NDArray[np.bool_] | None:
        """A byte for each pixel: a picture would be decoded for every window."""
        if self._mask is not None:
            return np.asarray(picture_codes(Path(self._mask), None, None).max(axis=0) > 0)
        if self._path.suffix.lower() == ".npz":
            found = read_npz(self._path, without="samples").get("mask")
            return None if found is None else np.asarray(found, np.bool_)
        return None


def check_source(source: Any, reader: str) -> None:
    """Refuse what has no windows that can be read again and again, in any order.

    Raises
    ------
    ArgumentError
        With what to do: ``reader`` cannot read it.
    """
    if isinstance(source, str | os.PathLike | Stack | Photographs):
        return
    kind = type(source).__name__
    if isinstance(source, Deferred):
        advice = (
            "fit it by impasto.fit_sbrdf, which leaves it lazy, or give the files that it is of: "
            "their paths, or a store of them (impasto ingest)"
        )
    else:
        advice = "expected the path of photographs, an impasto.Stack or an impasto.jobs.Photographs"
    raise ArgumentError(f"source: {reader} cannot read a {kind}; {advice}")


def open_photographs(
    source: Any, reading: Mapping[str, Any], memory: int, encoding: Encoding | None
) -> Photographs:
    """The photographs of a stack or of a path.

    Parameters
    ----------
    source
        A :class:`~impasto.Stack`, a :class:`Photographs`, or what :func:`impasto.read_stack` takes.
    reading
        Its options, as :func:`checked_reading` gives them.
    memory
        Bytes up to which all photographs are read at once.
    encoding
        Their tone curve, if it is known from an earlier call.
    """
    if isinstance(source, Stack | Photographs):
        if reading:
            raise ArgumentError(
                f"reading: a stack is read already, found {next(iter(reading))}; give a path"
            )
        return source if isinstance(source, Photographs) else StackInMemory(source)
    return Files(Path(source), reading, memory, encoding)


def checked_reading(reading: Mapping[str, Any] | None) -> dict[str, Any]:
    """Options of :func:`impasto.read_stack`, without those that have their default value.

    Raises
    ------
    ArgumentError
        An unknown one.
    """
    if not isinstance(reading, Mapping | None):
        raise ArgumentError(
            f"reading: expected options by name ({{'encoding': 'srgb'}}), found {reading!r}"
        )
    defaults = (None, False)
    given = {
        name: value
        for name, value in (reading or {}).items()
        if not any(value is default for default in defaults)
    }
    for name in given:
        if name not in READING:
            raise ArgumentError(
                f"reading: a job has no option {name!r} for photographs"
                f"{suggestion(name, READING)}; it knows {', '.join(READING)}"
            )
    return given


def _in_plain(notes: Iterable[Any]) -> list[list[str]]:
    return [[str(getattr(note, "kind", "")), str(note)] for note in notes]


def _trace(path: Path) -> tuple[int, ...]:
    """What changes with a file; nothing of one that is gone.

    Editors that keep the date of a file cannot keep that of its last change of any kind (ctime).
    """
    try:
        found = path.stat()
    except OSError:
        return ()
    return found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino


def _middle(size: tuple[int, int], wanted: tuple[int, int]) -> tuple[int, int, int, int]:
    """A region about the very middle, of so many rows and columns or one more."""
    height, width = (
        min(side, most + (side - most) % 2) for side, most in zip(size, wanted, strict=True)
    )
    return (size[0] - height) // 2, (size[1] - width) // 2, height, width


def _between_multiples(places: range, side: int) -> Iterator[slice]:
    """The numbers of those places that lie between the same multiples of ``side``."""
    start = 0
    while start < len(places):
        end = (places[start] // side + 1) * side
        stop = min(-(-(end - places.start) // places.step), len(places))
        yield slice(start, stop)
        start = stop


def _mapped(samples: Any) -> bool:
    """Whether an array, or what it is a view of, is a memory map of a file."""
    while samples is not None:
        if isinstance(samples, np.memmap):
            return True
        samples = getattr(samples, "base", None)
    return False


def _any_picture(path: Path, stack: Stack, reading: Mapping[str, Any]) -> Source:
    """One of the photographs, open; all are of one size and type."""
    if path.suffix.lower() in FINISHED:
        return open_source(path, index=0)
    for file in stack.sources:
        try:
            return open_source(file, layer=reading.get("layer"))
        except ImpastoError:  # a light file
            continue
    raise ArgumentError(f"source: {path} has no photograph that can be opened")
