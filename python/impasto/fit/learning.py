"""Learn what a fit must know about a whole painting, then apply it tile by tile."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, cast, overload

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback
from impasto._internal.checks import instance, truth
from impasto._internal.windows import widened, window, within
from impasto._internal.wording import counted
from impasto.effort import Effort, EffortLike, resolved
from impasto.errors import ArgumentError
from impasto.fit.choice import Choice
from impasto.fit.deferred import Deferred
from impasto.fit.lafortune import fit_lafortune
from impasto.fit.learned import LearnedLobe
from impasto.fit.lobes import HALO, LearnedLobes, LobeOptions, apply_lobes, learn_lobes
from impasto.fit.normals import LearnedNormals, Method, learn_normals
from impasto.fit.options import FitKind, Model, Pooling, fit_kind, fit_kinds
from impasto.fit.pooled import Extraction, apply_pooled, learn_pooled, pooled_sbrdf, without_gloss
from impasto.fit.relief import Relief
from impasto.fit.residuals import LearnedResiduals, apply_residuals
from impasto.fit.saved import arrays_of
from impasto.fit.stages import (
    Fitted,
    check_arguments,
    checked_options,
    chosen_kind,
    learned_relief,
    learned_residuals,
    relief_wanted,
    start_normals,
    with_refined_rig,
)
from impasto.fit.subsample import Sample, checked_stride
from impasto.io.results import read_maps, write_maps
from impasto.io.rig_arrays import arrays_of_rig, rig_of_arrays
from impasto.rig import Rig
from impasto.stack import Stack, checked_stack

if TYPE_CHECKING:
    from xarray import Dataset

KIND = "impasto.LearnedModel"


@dataclass(frozen=True, eq=False, repr=False)
class LearnedModel:
    """A model of a whole painting from :func:`learn_sbrdf`: what the fit of a tile needs of it.

    Attributes
    ----------
    model, pooling
        The fit; see :func:`impasto.fit_sbrdf`.
    extent
        Rows and columns of the whole painting.
    bands
        Number of bands.
    method
        The method of photometric stereo that the fit starts with; None: the default of
        :func:`impasto.fit_normals`.
    effort
        Accuracy against time.
    lobes
        Largest number of lobes per pixel; 1 with one lobe for the painting.
    fit
        The painting's lobe, or the prior of lobes per pixel; None for Lafortune lobes, which are
        fitted to each pixel alone.
    chosen
        What ``pooling="auto"`` chose, and against what; None where the caller chose.
    residuals
        How residuals are kept and interpolated; None: they are not kept.
    relief
        The painting's cast shadows and interreflections, which are taken off every stack; None:
        they do not count.
    rig
        The refined rig, which replaces that of every stack; None: it was not refined.
    stereo
        What the default of :func:`impasto.fit_normals` must know of the whole painting; None for
        other methods.
    """

    model: Model
    pooling: Pooling
    extent: tuple[int, int]
    bands: int
    method: Method | None
    effort: Effort
    lobes: int
    fit: LearnedLobe | LearnedLobes | None
    chosen: Choice | None = None
    residuals: LearnedResiduals | None = None
    relief: Relief | None = None
    rig: Rig | None = None
    stereo: LearnedNormals | None = None

    def __repr__(self) -> str:
        height, width = self.extent
        return (
            f"<LearnedModel {self.model}, pooling={self.pooling!r}, of {width} x {height} pixels, "
            f"{self.bands} bands, halo of {self.halo} pixels>"
        )

    def __str__(self) -> str:
        """The fit in words, with the painting's lobe and what was chosen against what."""
        if isinstance(self.fit, LearnedLobe):
            width = math.degrees(self.fit.gamma)
            own = f"beta {self.fit.beta:.3g}, gamma {width:.3g} degrees, {self.fit.verdict}"
            words = f"one lobe for the painting: {own}"
        elif self.pooling == "pixel":
            words = f"{self.model}, {counted(self.lobes, 'lobe')} per pixel at most"
        else:
            words = "photometric stereo alone"
        return words if self.chosen is None else f"{words} (chosen: {self.chosen})"

    @property
    def halo(self) -> int:
        """Width in pixels of the border around a tile that its fit needs, within the painting.

        The border contains the seeds of ``Effort(start="neighbours")``: the fits of every fourth
        pixel of every fourth row of the whole painting, from which searches around them start, and
        of every 16th of every 16th, from which these do.
        """
        seeds = isinstance(self.fit, LearnedLobes) and self.fit.options.start != "multistart"
        return HALO if seeds else 0

    def magnified(
        self, stride: int, extent: tuple[int, int], middle: tuple[float, float] = (0.0, 0.0)
    ) -> LearnedModel:
        """What was learned from every ``stride``-th row and column, for all of ``extent``.

        ``middle``: where the middle of ``extent`` lies, if that is a part of a painting.
        """
        fit, rig, relief = self.fit, self.rig, self.relief
        if isinstance(fit, LearnedLobes):
            fit = replace(fit, extent=extent, middle=middle)
        if rig is not None and rig.pitch_mm is not None:
            rig = Rig(rig, pitch_mm=rig.pitch_mm / stride)
        relief = None if relief is None else relief.magnified(stride)
        return replace(self, extent=extent, fit=fit, rig=rig, relief=relief)

    @overload
    def apply(
        self,
        stack: Stack,
        rows: slice = ...,
        columns: slice = ...,
        *,
        threads: int | None = ...,
        progress: bool | ProgressCallback = ...,
    ) -> Fitted: ...
    @overload
    def apply(self, stack: Deferred, *, threads: int | None = ...) -> Dataset: ...
    def apply(
        self,
        stack: Stack | Deferred,
        rows: slice = slice(None),
        columns: slice = slice(None),
        *,
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> Fitted | Dataset:
        """Fit a tile. Its maps are bit-identical to those of the whole painting.

        Parameters
        ----------
        stack
            Photographs of the painting, or of a part of it: ``stack[y0:y1, x0:x1]`` keeps its
            position (``rig.origin``). A :class:`LazyStack` is a whole painting: nothing is
            computed now.
        rows, columns
            The tile, in pixels of the stack; default: all of it. The stack must contain a border
            of :attr:`halo` pixels around it, except at the edges of the painting.
        threads, progress
            As in :func:`impasto.fit_sbrdf`.

        Returns
        -------
        Sbrdf
            Of the kind that :func:`impasto.fit_sbrdf` returns, of the size of the tile. Of a
            :class:`LazyStack` an ``xarray.Dataset`` of lazy maps, as ``to_xarray()`` makes it.

        Raises
        ------
        ArgumentError
            A stack of other bands; rows or columns that hold no pixel.
        GeometryError
            A stack that does not lie in the painting or does not reach far enough.
        """
        if isinstance(stack, Deferred):
            if (rows, columns) != (slice(None), slice(None)):
                raise ArgumentError("rows, columns: a lazy stack has tiles of its own; slice maps")
            return stack.applied(self, threads)
        checked_stack(stack)
        if stack.shape[1] != self.bands:
            raise ArgumentError(f"stack: expected {self.bands} bands, found {stack.shape[1]}")
        if self.rig is not None:
            if len(self.rig) != len(stack.rig):
                raise ArgumentError(
                    f"stack: expected {len(self.rig)} photographs, found {len(stack.rig)}"
                )
            stack = stack._replace(rig=Rig(self.rig, origin=stack.rig.origin))
        size = stack.shape[2:]
        tile = window((rows, columns), size)
        wide = widened(tile, size, self.halo)
        photographs = stack[wide]
        near = photographs
        if self.relief is not None:
            near = self.relief.removed(photographs, threads=threads)
        stereo = start_normals(near, self.method, self.effort, threads, progress, self.stereo)
        inner = within(tile, wide)
        if isinstance(self.fit, LearnedLobes):
            maps = apply_lobes(
                self.fit, near, stereo, inner=inner, threads=threads, progress=progress
            )
            options, there = self.fit.options, photographs[inner]
            lobes = maps.result(there, stereo[inner], options.index, coated=options.coated)
            return self._completed(lobes, there, threads)
        if isinstance(self.fit, LearnedLobe):
            pooled = apply_pooled(self.fit, near, stereo, threads=threads, progress=progress)
            found = pooled_sbrdf(self.fit, pooled, near, stereo)
            return self._completed(found, photographs, threads)
        if self.pooling == "none":
            return self._completed(without_gloss(near, stereo), photographs, threads)
        fitted = fit_lafortune(
            near, stereo, lobes=self.lobes, effort=self.effort, threads=threads, progress=progress
        )
        return self._completed(fitted, photographs, threads)

    def _completed(self, result: Fitted, stack: Stack, threads: int | None) -> Fitted:
        """A tile's result with what was chosen, the relief and, if wanted, its residuals."""
        result = replace(result, chosen=self.chosen, relief=self.relief)
        if self.residuals is None:
            return result
        kept = apply_residuals(self.residuals, stack, result, threads=threads)
        return replace(result, residuals=kept)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an ``.npz`` or ``.zarr`` for :func:`load_learned`; it appears whole or not at all.

        Raises
        ------
        ArgumentError
            Another suffix.
        """
        arrays: dict[str, Any] = {
            "model": self.model,
            "pooling": self.pooling,
            "extent": self.extent,
            "bands": self.bands,
            "method": self.method or "",
            "lobes": self.lobes,
        }
        # A field that is None is the default, and is left out.
        effort = {name: value for name, value in asdict(self.effort).items() if value is not None}
        arrays |= {f"effort.{name}": value for name, value in effort.items()}
        arrays |= {f"fit.{name}": array for name, array in _fit_arrays(self.fit).items()}
        arrays |= {} if self.chosen is None else self.chosen.arrays()
        arrays |= {} if self.residuals is None else arrays_of(self.residuals, "residuals.")
        arrays |= {} if self.relief is None else arrays_of(self.relief, "relief.")
        rig = {} if self.rig is None else arrays_of_rig(self.rig)
        arrays |= {f"rig.{name}": array for name, array in rig.items()}
        if self.stereo is not None:
            arrays |= {f"stereo.{name}": value for name, value in asdict(self.stereo).items()}
        write_maps(path, KIND, {name: np.asarray(value) for name, value in arrays.items()})


def learn_sbrdf(
    stack: Stack,
    *,
    model: Model = "torrance-sparrow",
    pooling: Pooling = "auto",
    lobes: int | None = None,
    ambient: bool | None = None,
    coated: bool | None = None,
    extraction: Extraction | None = None,
    peak: bool | None = None,
    joint: bool | None = None,
    index: float | None = None,
    normals: Method | None = None,
    refine: bool | None = None,
    residuals: bool | None = None,
    relief: bool | None = None,
    extent: tuple[int, int] | None = None,
    sample: int | None = None,
    effort: EffortLike = "standard",
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> LearnedModel:
    """Learn a model of a whole painting, for fitting it tile by tile.

    It contains the pooled lobe, or the prior of lobes per pixel.
    ``learn_sbrdf(stack).apply(stack)`` is bit-identical to ``fit_sbrdf(stack)``, and so are its
    tiles.

    A large painting is learned from a systematic sample, every third (fifth, seventh ...) row and
    column: as many as leave two million pixels, and 2^28 samples, at most.

    Parameters
    ----------
    stack
        The whole painting, or a sample of it: a part, or the whole with a mask.
    model, pooling, lobes, ambient, coated, extraction, peak, joint, index
        What is fitted, as in :func:`impasto.fit_sbrdf`.
    refine, residuals, relief, effort, threads, progress
        As in :func:`impasto.fit_sbrdf`. ``pooling="segment"`` has no learned model. A relief is
        learned from the whole painting only: from a part, with a larger ``extent``, there is none.
        Outside the mask of the stack it has no surface: a tile is fitted there as without a relief,
        and within the mask it lacks shadows and light of what is outside. If the mask only marks a
        sample, say ``relief=False``.
    normals
        The name of a method of :func:`impasto.fit_normals`; default: its own default.
    extent
        Rows and columns of the whole painting; default: those of the stack.
    sample
        The model is learned from every so many rows and columns, an odd number; 1: from all pixels.
        Default: as above.

    Returns
    -------
    LearnedModel
        Its ``apply`` fits a tile; ``save`` keeps it for :func:`load_learned`.

    Raises
    ------
    ArgumentError
        What :func:`impasto.fit_sbrdf` refuses; segments; an extent smaller than the stack;
        ``relief=True`` with a larger one; a sample that is no odd number from 1 on.
    GeometryError
        Lights that cannot determine normals, or views from behind alone.
    """
    checked_stack(stack)
    relief = None if relief is None else truth(relief, "relief")
    check_arguments(normals, residuals, threads, progress)
    size = _extent(extent, stack)
    whole = size == stack.shape[2:]
    if relief and not whole:
        raise ArgumentError(
            f"relief: a part of {stack.shape[2]} x {stack.shape[3]} pixels does not show what "
            f"shades it in the {size[0]} x {size[1]} of extent; learn from the whole painting"
        )
    if pooling == "segment":
        raise ArgumentError(
            'pooling: "segment" cannot be learned from a sample; fit every part by '
            'fit_sbrdf(stack, pooling="segment"), or ask for "painting" or "pixel"'
        )
    taken = Sample.of(stack) if sample is None else Sample(checked_stride(sample), stack.shape[2:])
    given = {
        "lobes": lobes,
        "ambient": ambient,
        "coated": coated,
        "extraction": extraction,
        "peak": peak,
        "joint": joint,
        "index": index,
    }
    middle = stack.rig.origin if whole else (0.0, 0.0)
    stack = taken.taken(stack)
    # Of a part the model is one of the whole; of every third pixel it becomes that.
    learned_size = size if taken.stride == 1 else taken.shape
    resolved_effort = resolved(effort)
    kinds = fit_kinds(model, pooling, given)
    before = stack.rig
    stack = with_refined_rig(stack, kinds, given, refine, maps=False, threads=threads)
    chosen = chosen_kind(stack, kinds, given, normals, residuals, threads, progress)
    checked_options(*chosen[1:])
    found = None
    if whole and relief_wanted(relief, chosen[0]):
        found, chosen = learned_relief(stack, kinds, given, chosen, normals, residuals, threads)
    choice, kind, given = chosen
    options = checked_options(kind, given)
    wanted = choice is not None if residuals is None else truth(residuals, "residuals")
    photographs = stack
    if found is not None:
        stack = found.removed(stack, threads=threads)
    fit: LearnedLobe | LearnedLobes | None = None
    known = None
    if normals in {None, "robust"}:
        known = learn_normals(stack, effort=resolved_effort, threads=threads)
    if kind.model != "lafortune" and kind.pooling != "none":
        stereo = start_normals(stack, normals, resolved_effort, threads, progress, known)
        fit = _learned(stack, stereo, options, resolved_effort, learned_size, threads, progress)
    model_of_sample = LearnedModel(
        kind.model,
        kind.pooling,
        learned_size,
        stack.shape[1],
        normals,
        resolved_effort,
        options.get("lobes", 1),
        fit,
        choice,
        learned_residuals(photographs, kind, given, normals, threads, found) if wanted else None,
        found,
        None if stack.rig is before else stack.rig,
        known,
    )
    return model_of_sample.magnified(taken.stride, size, middle)


def load_learned(path: str | os.PathLike[str]) -> LearnedModel:
    """Read a model that :meth:`LearnedModel.save` wrote.

    Raises
    ------
    CorruptInputError
        A file that is truncated, damaged or holds something else.
    FileNotFoundError
        There is none.
    """
    with read_maps(path, KIND) as maps:
        one = {name: np.asarray(array) for name, array in maps.arrays.items()}
        maps.take("model")
        kind = fit_kind(one["model"].item(), one["pooling"].item())
        rows, columns = (int(size) for size in one["extent"])
        return LearnedModel(
            kind.model,
            kind.pooling,
            (rows, columns),
            int(one["bands"]),
            cast("Method", one["method"].item()) or None,
            Effort(**{name: array.item() for name, array in _part(one, "effort.").items()}),
            int(one["lobes"]),
            _fit_of(kind, _part(one, "fit.")),
            Choice.of_maps(maps),
            _residuals_of(_part(one, "residuals.")),
            _relief_of(_part(one, "relief.")),
            rig_of_arrays(rig) if (rig := _part(one, "rig.")) else None,
            _stereo_of(_part(one, "stereo.")),
        )


def _learned(
    stack: Stack,
    stereo: Any,
    options: Mapping[str, Any],
    effort: Effort,
    extent: tuple[int, int],
    threads: int | None,
    progress: bool | ProgressCallback,
) -> LearnedLobe | LearnedLobes:
    if "lobes" in options:
        chosen = LobeOptions.of(effort, **options)
        return learn_lobes(stack, stereo, chosen, extent=extent, threads=threads, progress=progress)
    return learn_pooled(stack, stereo, effort=effort, threads=threads, progress=progress, **options)


def _extent(extent: tuple[int, int] | None, stack: Stack) -> tuple[int, int]:
    height, width = stack.shape[2:]
    if extent is None:
        return height, width
    rows, columns = extent
    instance(rows, int, "extent", "rows and columns as whole numbers")
    instance(columns, int, "extent", "rows and columns as whole numbers")
    if rows < height or columns < width:
        raise ArgumentError(
            f"extent: expected at least the {height} x {width} pixels of the stack, found {extent}"
        )
    return rows, columns


def _part(arrays: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }


def _fit_arrays(fit: LearnedLobe | LearnedLobes | None) -> dict[str, NDArray[Any]]:
    if fit is None:
        return {}
    return fit.to_arrays() if isinstance(fit, LearnedLobes) else fit.arrays()


def _fit_of(kind: FitKind, arrays: Mapping[str, NDArray[Any]]) -> LearnedLobe | LearnedLobes | None:
    if kind.model == "lafortune" or kind.pooling == "none":
        return None
    if kind.pooling == "pixel":
        return LearnedLobes.from_arrays(arrays)
    return LearnedLobe.from_arrays(arrays)


def _residuals_of(arrays: Mapping[str, NDArray[Any]]) -> LearnedResiduals | None:
    if not arrays:
        return None
    numbers = {name: float(arrays[name]) for name in ("length", "noise", "top", "gain")}
    return LearnedResiduals(basis=arrays["basis"].astype(np.float64), **numbers)


def _relief_of(arrays: Mapping[str, NDArray[Any]]) -> Relief | None:
    if not arrays:
        return None
    fields: dict[str, Any] = {
        name: array.item() if array.ndim == 0 else array for name, array in arrays.items()
    }
    return Relief(**fields)


def _stereo_of(arrays: Mapping[str, NDArray[Any]]) -> LearnedNormals | None:
    if not arrays:
        return None
    return LearnedNormals(**{name: float(array) for name, array in arrays.items()})
