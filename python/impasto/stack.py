"""All samples of one painting: photographs, who lit them and which bands they hold."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.casts import quiet_cast
from impasto._internal.checks import instance, numbers, picked, reachable, unmasked
from impasto._internal.named import (
    coordinate,
    in_order,
    is_named,
    light_directions,
    mask_in_order,
)
from impasto._internal.rotation import quarter_turns_of
from impasto._internal.waiting import BRIEF, floats, wait_for
from impasto._internal.windows import offset, rotated_map, window
from impasto.encoding import Encoding
from impasto.errors import ArgumentError, ImpastoWarning
from impasto.lights import Light
from impasto.rig import Rig, Views

SAMPLE_DTYPES = (np.uint8, np.uint16, np.float16, np.float32)
"""Sample types that are read in place and converted block by block."""

SAMPLE_INTEGERS = (np.uint8, np.uint16)
"""Those whose largest number is full scale."""

_MOST_LAST, _MOST_UNNAMED = 4, 16
"""A last axis of at most four beside more bands than filter wheels have is one of colours."""

DIVIDED = "board"
"""Kind of the note that photographs were divided by those of a white board."""
LONGEST_BAND = 200
"""Bytes of a band's name: OpenEXR's channels have at most 255 with what is written before it."""


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Stack:
    """Samples ``(obs, band, y, x)`` with their rig.

    A stored sample s means the linear value ``(s - black) * scale``, with a white board at 1.0.
    NaN is a sample that was never taken; +inf is one known to be clipped.

    Parameters
    ----------
    samples
        ``(obs, band, y, x)``, or ``(obs, y, x)`` for one band; uint8, uint16, float16 or float32
        are kept as they are (never copied if C-contiguous), other real numbers become float32.
        Integers of another type need ``scale``: their full scale is seldom that of the type.
        Masked samples become NaN. Floats that are whole numbers, as 8- or 16-bit codes are, are
        kept, with an :class:`ImpastoWarning`. The dimensions of a ``DataArray`` go by their names,
        in any order: observation (obs, photograph, image, light), band (channel), y (row), x
        (column); labels name bands and photographs, the coordinates ``light_x``, ``light_y`` and
        ``light_z`` of observations are directions to the lights.
    lights
        ``(obs, 3)`` directions, lights, or a :class:`Rig`; only a ``DataArray`` may bring its own.
    views, pitch_mm
        See :class:`Rig`.
    bands
        One name per band; default ``"red", "green", "blue"`` for three, ``"band 0"`` ... else.
        More than 16 bands of at most 4 pixels' width need names: unnamed, such an array is taken
        for pictures with colours last, and refused.
    mask
        ``(y, x)`` bool, True where the painting is; default: everywhere.
    saturation
        Stored value(s) from which a sample counts as clipped, one or one per band; default: the
        largest integer of an integer type, none for floats. Infinite: no sample is clipped.
    scale, black
        Stored to linear, one or one per band; default: full scale of an integer type is 1.0.
    encoding
        How linear light became the files' coded values; used by :meth:`encode` only.
    names
        One name per observation (file names, as a rule).
    notes
        What was repaired, dropped or assumed while the files were read; ``str`` of each is a
        sentence.
    sources
        Every file that was read: photographs, light file, mask, board and dark frames.
    """

    samples: NDArray[Any]
    rig: Rig
    bands: tuple[str, ...]
    mask: NDArray[np.bool_] | None
    saturation: NDArray[np.float64] | None
    scale: NDArray[np.float64]
    black: NDArray[np.float64]
    encoding: Encoding
    names: tuple[str, ...]
    notes: tuple[Any, ...]
    sources: tuple[Path, ...]

    def __init__(
        self,
        samples: ArrayLike,
        *,
        lights: ArrayLike | Sequence[Light] | Rig | None = None,
        views: Views | None = None,
        pitch_mm: float | None = None,
        bands: Sequence[str] | None = None,
        mask: ArrayLike | None = None,
        saturation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        black: ArrayLike = 0.0,
        encoding: Encoding | str = "linear",
        names: Sequence[str] | None = None,
        notes: Sequence[Any] = (),
        sources: Sequence[str | Path] = (),
    ) -> None:
        if is_named(samples):
            named: Any = in_order(samples, "samples")
            bands = coordinate(named, "band") if bands is None else bands
            names = coordinate(named, "observation") if names is None else names
            lights = light_directions(named) if lights is None else lights
            samples = named.values
        if lights is None:
            raise ArgumentError(
                "lights: expected directions (obs, 3), lights or a Rig, found none; a DataArray "
                "may have them as coordinates light_x, light_y and light_z"
            )
        codes = scale is None
        array, full = _samples(samples, scaled=not codes)
        if scale is None and full is None:
            _warn_of_codes(array)
        rig = Rig(lights, views=views, pitch_mm=pitch_mm)
        observations, count, height, width = array.shape
        if bands is None and width <= _MOST_LAST and count > _MOST_UNNAMED:
            raise ArgumentError(
                f"samples: {count} bands of {width} x {height} pixels, found shape {array.shape}: "
                "is that (obs, y, x, band)? np.moveaxis(samples, -1, 1) makes (obs, band, y, x); "
                "if not, name the bands (bands=)"
            )
        if len(rig) != observations:
            raise ArgumentError(
                f"lights: {observations} observations need {observations} lights, found {len(rig)}"
            )
        if saturation is None and full is not None:
            saturation = full
        if scale is None:
            scale = 1.0 if full is None else 1.0 / full
        if isinstance(encoding, str):
            encoding = Encoding(encoding, 1.0 if full is None else full)
        set_ = object.__setattr__
        set_(self, "samples", array)
        set_(self, "rig", rig)
        set_(self, "bands", _checked_bands(_names(bands, _band_names(count), "bands")))
        set_(self, "mask", _mask(mask, (height, width)))
        set_(
            self,
            "saturation",
            None if saturation is None else _per_band(saturation, count, "saturation"),
        )
        if self.saturation is not None and not (self.saturation > 0.0).all():
            raise ArgumentError(
                "saturation: expected the level from which samples are clipped, above 0, found "
                f"{self.saturation.tolist()}"
            )
        if self.saturation is not None and full is not None and codes:
            reachable(self.saturation, int(full))
        set_(self, "scale", _per_band(scale, count, "scale"))
        set_(self, "black", _per_band(black, count, "black"))
        if not np.isfinite(self.black).all():
            raise ArgumentError("black: expected finite numbers, found infinity")
        set_(self, "encoding", encoding)
        set_(self, "names", _names(names, [f"{i}" for i in range(observations)], "names"))
        set_(self, "notes", tuple(notes))
        set_(self, "sources", tuple(Path(path) for path in sources))
        if not (np.isfinite(self.scale) & (self.scale > 0)).all():
            raise ArgumentError(f"scale: expected positive numbers, found {scale}")

    def __repr__(self) -> str:
        observations, bands, height, width = self.shape
        return (
            f"<Stack {observations} photographs of {width} x {height} pixels, "
            f"{bands} band{'s' * (bands != 1)}, "
            f"{self.samples.dtype}, {self._curve_words}>"
        )

    def _repr_html_(self) -> str:
        """HTML for notebooks: size, lights, and the mean of some photographs."""
        from impasto.notebook import stack_view

        return stack_view(self)

    @property
    def encoding_source(self) -> str:
        """How the curve is known: ``"given"``, ``"profile"``, ``"estimated"`` or ``"assumed"``."""
        found = [str(getattr(note, "how", "")) for note in self.notes if _about_encoding(note)]
        return next((how for how in found if how), "given")

    @property
    def divided_by_board(self) -> bool:
        """Whether the reader divided the photographs by those of a white board, says its note."""
        return any(getattr(note, "kind", "") == DIVIDED for note in self.notes)

    @property
    def _curve_words(self) -> str:
        """``srgb`` if that was given, else as in ``srgb (assumed)``."""
        source = self.encoding_source
        return self.encoding.name + ("" if source == "given" else f" ({source})")

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """``(obs, band, y, x)``."""
        observations, bands, height, width = self.samples.shape
        return observations, bands, height, width

    def take(self, indices: Iterable[int]) -> Stack:
        """The stack of some observations, in the order given; negative ones count from the end.

        A run of neighbours (0, 1, 2 ...) shares memory with this stack; other picks copy.
        """
        chosen = picked(indices, len(self.rig), "indices", "observation")
        run = chosen == list(range(chosen[0], chosen[0] + len(chosen)))
        if run:
            samples = self.samples[chosen[0] : chosen[0] + len(chosen)]
        else:
            take, small = self.samples.take, len(chosen) * self.samples[0].size <= BRIEF
            samples = take(chosen, axis=0) if small else wait_for(take, chosen, axis=0)
        return self._replace(
            samples=samples, rig=self.rig.take(chosen), names=[self.names[i] for i in chosen]
        )

    def __getitem__(self, key: Any) -> Stack:
        """``stack[y0:y1, x0:x1]``: a part of the photographs, copied; near lights stay right."""
        size = self.shape[2:]
        rows, columns = part = window(key, size)
        return self._at(rows, columns, rig=self.rig.part(*offset(part, size)))

    def _at(self, rows: Any, columns: Any, **changes: Any) -> Stack:
        """The stack of some pixels, by slices or by arrays of their numbers."""
        mask = None if self.mask is None else self.mask[rows, columns]
        samples = wait_for(self._samples_at, rows, columns)
        return self._replace(**{"samples": samples, "mask": mask, **changes})

    def _samples_at(self, rows: Any, columns: Any) -> NDArray[Any]:
        return np.ascontiguousarray(self.samples[..., rows, columns])

    def rotated(self, quarter_turns: int = 1) -> Stack:
        """The photographs after quarter turns counterclockwise, with their lights and views.

        Coordinates only change places and signs: four turns change no bit.
        """
        turns = quarter_turns_of(quarter_turns)
        if not turns:
            return self
        samples = wait_for(np.ascontiguousarray, rotated_map(self.samples, turns))
        mask = None if self.mask is None else rotated_map(self.mask, turns)
        return self._replace(samples=samples, rig=self.rig.rotated(turns), mask=mask)

    def linear(self, index: int) -> NDArray[np.float32]:
        """One observation as linear light ``(band, y, x)``; clipped samples are +inf."""
        return self._linear(self.samples[index])

    def _linear(self, samples: NDArray[Any]) -> NDArray[np.float32]:
        stored = samples.astype(np.float32)
        with quiet_cast():
            black, scale = (
                one[:, None, None].astype(np.float32) for one in (self.black, self.scale)
            )
            value = (stored - black) * scale
            if self.saturation is not None:
                # In single precision, as the numerics compare: 0.9 is less there.
                value[stored >= self.saturation[:, None, None].astype(np.float32)] = np.inf
        return np.asarray(value, dtype=np.float32)

    @property
    def ceiling(self) -> NDArray[np.float32]:
        """``(band,)``: linear light from which samples are clipped; +inf without saturation."""
        if self.saturation is None:
            return np.full(self.shape[1], np.inf, np.float32)
        with quiet_cast():
            return np.asarray((self.saturation - self.black) * self.scale, dtype=np.float32)

    def encode(self, linear: ArrayLike) -> NDArray[np.float32]:
        """Linear values back to the files' coded values: 0 .. full scale, clipped, not rounded.

        Held-out photographs are compared on these (PSNR on coded values).
        """
        return self.encoding.encode(linear)

    def _replace(self, **changes: Any) -> Stack:
        arguments: dict[str, Any] = {
            "samples": self.samples,
            "bands": self.bands,
            "mask": self.mask,
            "saturation": self.saturation,
            "scale": self.scale,
            "black": self.black,
            "encoding": self.encoding,
            "names": self.names,
            "notes": self.notes,
            "sources": self.sources,
        } | changes
        samples = arguments.pop("samples")
        rig = arguments.pop("rig", self.rig)
        return Stack(samples, lights=rig, **arguments)


def _about_encoding(note: Any) -> bool:
    return getattr(note, "kind", "") == "encoding"


def _samples(samples: ArrayLike, *, scaled: bool) -> tuple[NDArray[Any], float | None]:
    """``(obs, band, y, x)`` in a type that is read in place, and the full scale of integers."""
    array, masked = unmasked(samples)
    # The other byte order is the same type.
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    full = float(np.iinfo(array.dtype).max) if array.dtype in SAMPLE_INTEGERS else None
    if masked is not None:
        array = wait_for(np.where, masked, np.float32(np.nan), floats(array))
    if array.ndim == 3:
        array = array[:, None]
    if array.ndim != 4:
        raise ArgumentError(
            f"samples: expected (obs, band, y, x) or (obs, y, x), found shape {array.shape}"
        )
    if 0 in array.shape:
        raise ArgumentError(f"samples: an axis is empty, found shape {array.shape}")
    if array.dtype not in SAMPLE_DTYPES:
        if array.dtype.kind not in "fiub":
            raise ArgumentError(f"samples: expected real numbers, found dtype {array.dtype}")
        if array.dtype.kind in "iu" and not scaled:
            raise ArgumentError(
                f"samples: integers of type {array.dtype} do not say which code is white; give "
                "scale= (1 / full scale) and saturation=, or uint8, uint16 or floating point"
            )
        array = floats(array)
    whole = array.flags.c_contiguous
    return array if whole else wait_for(np.ascontiguousarray, array), full


CODES = 4.0
"""A median of whole numbers above this is one of codes: linear light is 1 on a white board."""

_LEVELS = 8
"""Fewer different samples are a test card, not a photograph."""


def _warn_of_codes(samples: NDArray[Any]) -> None:
    """Point out floats that are whole numbers, as the codes of a camera are."""
    flat = samples.reshape(-1)
    # The mean of two samples near the largest float32 must not overflow.
    with quiet_cast():
        some = np.asarray(flat[:: max(1, flat.size // 4096)], dtype=np.float64)
    known = some[np.isfinite(some)]
    median = float(np.median(known)) if known.size else 0.0
    whole = median > CODES and bool((known == np.rint(known)).all())
    if whole and np.unique(known).size >= _LEVELS and float(known.max()) <= 65535.0:
        full = 255 if float(known.max()) <= 255.0 else 65535
        warnings.warn(
            f"samples: these floats are whole numbers, half of them above {median:.3g}, but a "
            f"white board is 1.0 in linear light; if they are codes, give scale=1/{full} and "
            f"saturation={full}",
            ImpastoWarning,
            stacklevel=3,
        )


def _mask(mask: ArrayLike | None, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
    if mask is None:
        return None
    array = np.asarray(mask_in_order(mask))
    if array.shape != shape:
        raise ArgumentError(f"mask: expected shape {shape}, found {array.shape}")
    if array.dtype.kind not in "biuf":
        raise ArgumentError(f"mask: expected bool, found dtype {array.dtype}")
    # A bool that is a view of other bytes, as of a mask's 0 and 255, is still True for numpy, but
    # no bool in Rust.
    return np.ascontiguousarray(array != 0)


def checked_stack(stack: Any) -> Stack:
    """The stack, or a refusal that says how to make one."""
    made_by = "impasto.read_stack(path) or impasto.Stack(samples, lights=directions)"
    instance(stack, Stack, "stack", f"an impasto.Stack, as of {made_by}")
    found: Stack = stack
    return found


def _per_band(values: ArrayLike, count: int, name: str) -> NDArray[np.float64]:
    array = numbers(values, name, "numbers")
    if array.shape not in {(), (1,), (count,)}:
        raise ArgumentError(
            f"{name}: expected one number or one per band ({count}), found shape {array.shape}"
        )
    if np.isnan(array).any():
        raise ArgumentError(f"{name}: found NaN")
    return np.ascontiguousarray(np.broadcast_to(array, (count,)))


def _band_names(count: int) -> list[str]:
    if count == 3:
        return ["red", "green", "blue"]
    return ["grey"] if count == 1 else [f"band {i}" for i in range(count)]


def _names(names: Sequence[str] | None, default: list[str], what: str) -> tuple[str, ...]:
    if names is None:
        return tuple(default)
    if len(names) != len(default):
        raise ArgumentError(f"{what}: expected {len(default)} names, found {len(names)}")
    return tuple(str(name) for name in names)


def _checked_bands(bands: tuple[str, ...]) -> tuple[str, ...]:
    """Bands become channels of files: each needs a name of its own."""
    for index, band in enumerate(bands):
        if not band.strip() or not band.isprintable():
            raise ArgumentError(f"bands: band {index} has no printable name, found {band!r}")
        if len(band.encode()) > LONGEST_BAND:
            raise ArgumentError(
                f"bands: the name of band {index} is longer than {LONGEST_BAND} bytes, "
                f"it begins with {band[:20]!r}"
            )
        if band in bands[:index]:
            raise ArgumentError(f"bands: bands {bands.index(band)} and {index} are both {band!r}")
    return bands
