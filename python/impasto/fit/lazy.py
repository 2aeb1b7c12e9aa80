"""Photographs in a dask array: learned from some pixels, then one task per tile makes its maps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from impasto._internal.extras import need
from impasto._internal.named import in_order, is_named, mask_in_order
from impasto._internal.windows import Window, offset, widened, within
from impasto.errors import ArgumentError, GeometryError
from impasto.fit.dataset import dataset_of, labelled
from impasto.fit.deferred import Deferred
from impasto.fit.learning import LearnedModel, learn_sbrdf
from impasto.fit.normals import fit_normals, learn_normals
from impasto.fit.subsample import Sample, checked_stride
from impasto.rig import Rig
from impasto.stack import Stack

if TYPE_CHECKING:
    from xarray import Dataset

ALBEDO = 0.5
"""Of the flat matte pixel whose fit shows which maps there will be."""
CHUNK = 512
"""Rows and columns of the chunks of maps that small tiles share, at most. Handing out the maps of a
tile takes a task each, and Dask a millisecond or two for a task; whoever asks for a pixel has the
fit of a chunk."""


class LazyStack(Deferred):
    """Photographs in a dask array, or in an xarray ``DataArray`` of one: a whole painting.

    :func:`fit_sbrdf`, :func:`fit_normals` and :meth:`LearnedModel.apply` take it and return an
    ``xarray.Dataset`` of dask arrays: nothing of it is computed until its values are asked for.
    Every chunk ``(y, x)`` of the samples is a tile, and one task makes all its maps, on one thread
    unless ``threads=`` says more; tiles that are smaller share the chunks of the maps, of 512 x 512
    pixels at most. Compute the maps that you need together, as by
    ``dataset.compute()`` or ``dataset.to_zarr(...)``: each of these calls fits every tile once.

    What the fit must know of the whole painting is learned first, from every ``sample``-th row and
    column; these are computed at once. Without ``sample`` the maps are those of the fit of a
    :class:`Stack`, bit for bit.

    Parameters
    ----------
    samples
        As for :class:`Stack`, ``(obs, band, y, x)`` or ``(obs, y, x)``, in a dask array. Chunks
        along observations and bands are merged into one; those along y and x stay.
    mask
        ``(y, x)``, a numpy or a dask array; default: everywhere.
    sample
        An odd number; 1: all pixels. Default: that of :func:`learn_sbrdf`, for which a mask is
        computed.
    **options
        Of :class:`Stack`: lights, views, pitch_mm, bands, saturation, scale, black, encoding,
        names.

    Raises
    ------
    ArgumentError
        No dask array, chunks of unknown size, a mask of another size, or what :class:`Stack`
        refuses.
    MissingExtraError
        dask or xarray is not installed.
    """

    def __init__(
        self, samples: Any, *, mask: Any = None, sample: int | None = None, **options: Any
    ) -> None:
        need("dask.array", "scale", "a lazy stack")
        need("xarray", "scale", "a lazy stack")
        import dask.array

        array = in_order(samples, "samples") if is_named(samples) else samples
        lazy = array.data if is_named(array) else array
        if not isinstance(lazy, dask.array.Array):
            raise ArgumentError(
                f"samples: expected a dask array, found {type(lazy).__name__}; impasto.Stack takes "
                "arrays in memory"
            )
        if lazy.ndim not in {3, 4}:
            raise ArgumentError(
                f"samples: expected (obs, band, y, x) or (obs, y, x), found shape {lazy.shape}"
            )
        if any(map(math.isnan, lazy.shape)):
            raise ArgumentError(
                "samples: have chunks of unknown size; call compute_chunk_sizes() of the array"
            )
        one = np.zeros((*lazy.shape[:-2], 1, 1), lazy.dtype)
        if is_named(array):
            one = array[..., :1, :1].copy(data=one)
        # Everything but the samples.
        self._pixel = Stack(one, **options)
        if self.rig.origin != (0.0, 0.0):
            raise ArgumentError(
                "lights: a lazy stack is a whole painting, this rig is of a part of one (origin)"
            )
        lazy = lazy if lazy.ndim == 4 else lazy[:, None]
        self._samples = lazy.rechunk({0: -1, 1: -1})
        size = self._samples.shape[2:]
        mask = mask_in_order(mask)
        if mask is not None and tuple(mask.shape) != size:
            raise ArgumentError(f"mask: expected shape {size}, found {tuple(mask.shape)}")
        chunks = self._samples.chunks[2:]
        self._mask = None if mask is None else dask.array.asarray(mask).rechunk(chunks)
        self._given_stride = None if sample is None else checked_stride(sample)

    def __repr__(self) -> str:
        observations, bands, height, width = self.shape
        down, across = (len(sizes) for sizes in self._samples.chunks[2:])
        return (
            f"<LazyStack {observations} photographs of {width} x {height} pixels, {bands} bands, "
            f"{self._samples.dtype}, {down} x {across} tiles>"
        )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """``(obs, band, y, x)``."""
        observations, bands, height, width = self._samples.shape
        return observations, bands, height, width

    @property
    def rig(self) -> Rig:
        """Who lit and who looked."""
        return self._pixel.rig

    def sampled(self) -> Stack:
        """The pixels from which a model is learned, computed: every ``sample``-th of both axes."""
        import dask

        rows, columns = self._sample.window
        mask = None if self._mask is None else self._mask[rows, columns]
        samples, mask = dask.compute(self._samples[..., rows, columns], mask)
        return self._pixel._replace(samples=samples, mask=mask, rig=self._sample.rig(self.rig))

    @cached_property
    def _sample(self) -> Sample:
        if self._given_stride is not None:
            return Sample(self._given_stride, self._size)

        def inside(some: Sample) -> int:
            if self._mask is None:
                return some.count(None)
            return int((self._mask[some.window] != 0).sum().compute())

        return Sample.to_learn(self._size, math.prod(self.shape[:2]), inside)

    def fitted_sbrdf(self, **options: Any) -> Dataset:
        """See :func:`impasto.fit_sbrdf`."""
        if options.pop("segments") is not None:
            raise ArgumentError("segments: a lazy stack is fitted tile by tile, without segments")
        if options.pop("check"):
            raise ArgumentError("check: examine a stack in memory; leave it out of a lazy fit")
        if not isinstance(options["normals"], str | None):
            raise ArgumentError("normals: a lazy fit takes the name of a method, no maps")
        few = learn_sbrdf(self.sampled(), sample=1, **options)
        return self.applied(few.magnified(self._sample.stride, self._size), options["threads"])

    def fitted_normals(self, **options: Any) -> Dataset:
        """See :func:`impasto.fit_normals`."""
        if options["method"] == "robust" and options["learned"] is None:
            known = {name: options[name] for name in ("steps", "selection", "effort", "threads")}
            options["learned"] = learn_normals(self.sampled(), **known)
        options |= {"threads": options["threads"] or 1, "progress": False}

        def fit(stack: Stack, rows: slice, columns: slice) -> Any:
            return fit_normals(stack, **options)

        result = self._fitted(fit, 0)
        return labelled(result, self.rig, self._pixel.bands, {"kind": "impasto.Normals"})

    def applied(self, model: LearnedModel, threads: int | None) -> Dataset:
        """See :meth:`impasto.LearnedModel.apply`."""
        if model.extent != self._size:
            raise GeometryError(
                f"stack: has {self._size[0]} x {self._size[1]} pixels, the model is one of "
                f"{model.extent[0]} x {model.extent[1]}; a lazy stack is the whole painting"
            )
        # They are no part of a dataset.
        model = replace(model, residuals=None)

        def fit(stack: Stack, rows: slice, columns: slice) -> Any:
            return model.apply(stack, rows, columns, threads=threads or 1)

        return dataset_of(self._fitted(fit, model.halo))

    @property
    def _size(self) -> tuple[int, int]:
        return self.shape[2], self.shape[3]

    def _fitted(self, fit: Fit, halo: int) -> Any:
        """The result of the whole painting, whose maps are dask arrays."""
        import dask.array
        from dask.array.overlap import overlap

        samples, mask = self._samples, self._mask
        if halo:
            around = {samples.ndim - 2: halo, samples.ndim - 1: halo}
            samples = overlap(samples, around, "none")
            if mask is not None:
                mask = overlap(mask, {0: halo, 1: halo}, "none")
        rows, columns = (_inner(sizes, halo) for sizes in samples.chunks[2:])
        tiles = _Tiles(self._pixel, self._size, rows, columns, halo, fit)
        first = tiles.of_a_flat_pixel()
        results = dask.array.map_blocks(
            _fitted_block,
            samples,
            *([] if mask is None else [mask[None, None]]),
            drop_axis=[0, 1],
            chunks=((1,) * len(rows), (1,) * len(columns)),
            dtype=object,
            meta=np.empty((0, 0), object),
            # A task of its own: it goes to a worker once, not with every tile.
            tiles=dask.delayed(tiles, name=f"impasto-model-{uuid4().hex}", traverse=False),
        )
        down, across = _shared(rows), _shared(columns)
        results = results.rechunk((tuple(map(len, down)), tuple(map(len, across))))
        maps: dict[str, Any] = {
            name: _taken(results, name, plane, down, across)
            for name, plane in _maps_of(first).items()
        }
        if isinstance(getattr(first, "rig", None), Rig):
            maps["rig"] = Rig(first.rig, origin=(0.0, 0.0))
        return replace(first, **maps)


Fit = Callable[[Stack, slice, slice], Any]
"""The result of a tile: photographs, and its rows and columns among theirs."""


@dataclass(frozen=True)
class _Tiles:
    """Fits blocks of a dask array.

    Attributes
    ----------
    pixel
        Everything of the stack but its samples.
    size
        Rows and columns of the painting.
    rows, columns
        Of the tiles.
    halo
        Width of the border around every block, within the painting.
    fit
        What is done.
    """

    pixel: Stack
    size: tuple[int, int]
    rows: list[slice]
    columns: list[slice]
    halo: int
    fit: Fit

    def __call__(
        self,
        samples: NDArray[Any],
        mask: NDArray[Any] | None,
        block_id: tuple[int, int],
    ) -> NDArray[Any]:
        """One block: its maps by name, alone in an array of objects."""
        tile = self.rows[block_id[0]], self.columns[block_id[1]]
        result = self.result(tile, samples, None if mask is None else mask[0, 0])
        found = np.empty((1, 1), object)
        found[0, 0] = _maps_of(result)
        return found

    def result(self, tile: Window, samples: NDArray[Any], mask: NDArray[Any] | None) -> Any:
        """The result of a tile from its samples and those of the border around it."""
        wide = widened(tile, self.size, self.halo)
        rig = self.pixel.rig.part(*offset(wide, self.size))
        stack = self.pixel._replace(samples=samples, mask=mask, rig=rig)
        return self.fit(stack, *within(tile, wide))

    def of_a_flat_pixel(self) -> Any:
        """The result of one matte pixel in the corner, for the kinds of its maps."""
        height, width = (min(1 + self.halo, length) for length in self.size)
        pixel = self.pixel
        light = ALBEDO * np.maximum(pixel.rig.directions[:, 2], 0.0)
        stored = light[:, None] / pixel.scale + pixel.black
        samples = np.empty((*stored.shape, height, width), pixel.samples.dtype)
        samples[...] = stored[..., None, None]
        return self.result((slice(0, 1), slice(0, 1)), samples, None)


def _maps_of(result: Any) -> dict[str, NDArray[Any]]:
    """The arrays over the pixels ``(..., y, x)`` in the fields of a result, by name."""
    return {
        one.name: getattr(result, one.name)
        for one in fields(result)
        if tuple(one.metadata.get("dims", ())[-2:]) == ("y", "x")
    }


def _fitted_block(
    samples: NDArray[Any],
    mask: NDArray[Any] | None = None,
    *,
    tiles: _Tiles,
    block_id: tuple[int, int],
) -> NDArray[Any]:
    return tiles(samples, mask, block_id)


def _taken(
    results: Any,
    name: str,
    plane: NDArray[Any],
    down: list[list[slice]],
    across: list[list[slice]],
) -> Any:
    """One map of all tiles, as a dask array; ``plane`` is that of a pixel.

    ``down`` and ``across``: rows and columns of the tiles in every chunk.
    """
    import dask.array

    leading = plane.shape[:-2]
    return dask.array.map_blocks(
        _map_of,
        results,
        which=name,
        new_axis=list(range(len(leading))) or None,
        chunks=(*((n,) for n in leading), _sizes(down), _sizes(across)),
        dtype=plane.dtype,
        meta=np.empty((0,) * plane.ndim, plane.dtype),
    )


def _map_of(results: NDArray[Any], which: str) -> Any:
    if results.size == 1:
        return results[0, 0][which]
    return np.block([[one[which] for one in row] for row in results])


def _shared(tiles: list[slice]) -> list[list[slice]]:
    """Tiles along an axis, those together that share a chunk of the maps."""
    shared: list[list[slice]] = []
    for tile in tiles:
        if shared and tile.stop - shared[-1][0].start <= CHUNK:
            shared[-1].append(tile)
        else:
            shared.append([tile])
    return shared


def _sizes(chunks: list[list[slice]]) -> tuple[int, ...]:
    return tuple(tiles[-1].stop - tiles[0].start for tiles in chunks)


def _inner(sizes: tuple[int, ...], halo: int) -> list[slice]:
    """The tiles along an axis whose blocks have a border where they have neighbours."""
    found, start = [], 0
    for index, size in enumerate(sizes):
        stop = start + size - halo * ((index > 0) + (index < len(sizes) - 1))
        found.append(slice(start, stop))
        start = stop
    return found
