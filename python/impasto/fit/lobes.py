"""Every pixel's own lobes about a free normal, and what they show under other lights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import StackArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import is_whole, refractive_index
from impasto.effort import PRESETS, Effort, Origin, Precision
from impasto.errors import ArgumentError
from impasto.fit.normals import Normals
from impasto.fit.result import PerPixelSbrdf, shared_fields
from impasto.fit.saved import over
from impasto.fit.start import StartArguments
from impasto.io.results import SavedMaps
from impasto.stack import Stack
from impasto.surface import Surface

MOST_LOBES = 3


@dataclass(frozen=True, eq=False, repr=False)
class LobeSbrdf(PerPixelSbrdf):
    """A painting whose pixels have Torrance-Sparrow lobes of their own.

    The model is eq. 1 of the six-band paper with a strength per band and lobe, and a constant:
    ``irradiance * (diffuse N.L + sum over lobes of specular D F G / (N.V)) + ambient``; where
    ``coated``, ``N.L`` is multiplied by what a smooth interface transmits (:class:`Surface`).
    Varnish is a lobe with equal strengths (``beta`` of eq. 1), gold one with a diffuse part near 0
    and coloured strengths. :class:`Sbrdf` has the members of all results. ``sigma`` is at most
    pi / 2: the photographs do not determine the normal. There is no ``verdict`` of the painting,
    as in :class:`PooledSbrdf` and :class:`LafortuneSbrdf`: see ``lobes``, ``status`` and
    ``converged`` of each pixel.

    Attributes
    ----------
    specular
        ``(lobe, band, y, x)`` float32: the strength (``beta`` of eq. 1) of each lobe in each band;
        0 where a pixel has fewer lobes.
    lobes
        ``(y, x)`` uint8: number of lobes that the photographs support.
    ambient
        ``(band, y, x)`` float32: light that does not depend on the lamp's direction
        (inter-reflections, a room that is not dark), relative to the white board.
    gamma
        ``(lobe, y, x)`` float32: half-width of the lobe's facets, radians; narrowest first.
    gamma_sigma
        ``(lobe, y, x)`` float32: standard deviation of log gamma. Also NaN where a search ended
        early (``converged``) at an undetermined width.
    tinted
        ``(lobe, y, x)`` bool: whether the photographs support a strength per band (gold, bronzing);
        False where one strength fits all bands (varnish), or the pixel has no such lobe.
    converged
        ``(y, x)`` bool: whether the pixel's last search ended by its convergence tests; False where
        it ran out of steps or stalled, and where nothing is estimated.
    index
        Index of refraction of the interface.
    coated
        Whether diffuse light crosses that interface.
    """

    SHAPE: ClassVar[tuple[str, ...]] = ("gamma",)

    ambient: NDArray[np.float32] = field(metadata=over("band", "y", "x"))
    gamma: NDArray[np.float32] = field(metadata=over("lobe", "y", "x", unit="rad"))
    gamma_sigma: NDArray[np.float32] = field(metadata=over("lobe", "y", "x"))
    tinted: NDArray[np.bool_] = field(metadata=over("lobe", "y", "x", dtype=np.bool_))
    converged: NDArray[np.bool_] = field(metadata=over("y", "x", dtype=np.bool_))
    index: float = field(metadata=over(dtype=np.float64))
    coated: bool = field(default=False, metadata=over(dtype=np.bool_))

    def surface(self) -> Surface:
        """The painting with the lobes and the ambient light of every pixel, for rendering."""
        return Surface.torrance_sparrow(
            self.normal,
            self.diffuse,
            self.specular,
            self.gamma,
            index=self.index,
            ambient=self.ambient,
            coated=self.coated,
            **self._place(),
        )

    @property
    def width(self) -> NDArray[np.float32]:
        """``gamma``, under the name that lobes of all models have."""
        return self.gamma

    def _shape_sigma(self, lobe: int, y: int, x: int) -> float:
        return float(self.gamma_sigma[lobe, y, x])

    def report(self) -> dict[str, Any]:
        """Numbers of the gloss for a report file."""
        return {**super().report(), "index": self.index, "coated": self.coated}

    def _gloss(self) -> str:
        return super()._gloss() + " under a varnish" * self.coated

    def _demand(self, maps: SavedMaps, prefix: str = "") -> None:
        refractive_index(self.index)


HALO = _core.HALO
"""Pixels around a tile whose samples its fit needs, as far as the painting reaches, where searches
start from neighbours."""


@dataclass(frozen=True, slots=True)
class LobeOptions:
    """How lobes are fitted; ``rounds`` to ``precision`` are those of :class:`impasto.Effort`.

    With ``coated`` diffuse light crosses a smooth interface of index ``index``. ``typical=False``
    takes no prior from the painting's other pixels, and ``sparing=False`` gives a pixel every lobe
    that lowers its cost, worth its unknowns or not. ``bounded``: no lobe is wider than 0.25 rad
    while the normal is free, unless the painting has broader ones.
    """

    lobes: int
    ambient: bool
    index: float
    rounds: int
    iterations: int
    colour_iterations: int
    start: Origin
    precision: Precision
    coated: bool = False
    typical: bool = True
    sparing: bool = True
    bounded: bool = True

    @classmethod
    def of(
        cls, effort: Effort, *, lobes: int, ambient: bool, index: float, **others: bool
    ) -> LobeOptions:
        """The options of an effort."""
        return cls(
            lobes,
            ambient,
            index,
            effort.rounds,
            effort.iterations,
            effort.iterations if effort.colour_iterations is None else effort.colour_iterations,
            effort.start,
            effort.precision,
            **others,
        )


@dataclass(frozen=True, slots=True, eq=False)
class LobeMaps:
    """C-contiguous arrays that a fit fills, memory maps among them; see :class:`LobeSbrdf`.

    ``parameters`` ``(lobe, parameter, y, x)`` holds ``gamma``, ``deviation`` its
    ``gamma_sigma``; ``tinted`` and ``converged`` are uint8, 0 or 1.
    """

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    ambient: NDArray[np.float32]
    specular: NDArray[np.float32]
    parameters: NDArray[np.float32]
    deviation: NDArray[np.float32]
    tinted: NDArray[np.uint8]
    lobes: NDArray[np.uint8]
    residual: NDArray[np.float32]
    sigma: NDArray[np.float32]
    converged: NDArray[np.uint8]
    status: NDArray[np.uint8]

    @classmethod
    def empty(cls, bands: int, lobes: int, size: tuple[int, int]) -> LobeMaps:
        """Arrays for ``size`` rows and columns."""

        def planes(*shape: int) -> NDArray[np.float32]:
            return np.empty((*shape, *size), dtype=np.float32)

        def codes(*shape: int) -> NDArray[np.uint8]:
            return np.empty((*shape, *size), dtype=np.uint8)

        return cls(
            normal=planes(3),
            diffuse=planes(bands),
            ambient=planes(bands),
            specular=planes(lobes, bands),
            parameters=planes(lobes, 1),
            deviation=planes(lobes),
            tinted=codes(lobes),
            lobes=codes(),
            residual=planes(),
            sigma=planes(),
            converged=codes(),
            status=codes(),
        )

    def result(
        self, stack: Stack, stereo: Normals, index: float, *, coated: bool = False
    ) -> LobeSbrdf:
        """The maps as a result, together with those of photometric stereo; nothing is copied."""
        found = {name: getattr(self, name) for name in self.__slots__}
        return LobeSbrdf(
            **shared_fields(found, stack, stereo),
            ambient=self.ambient,
            specular=self.specular,
            gamma=self.parameters[:, 0],
            gamma_sigma=self.deviation,
            tinted=self.tinted.view(np.bool_),
            lobes=self.lobes,
            converged=self.converged.view(np.bool_),
            index=index,
            coated=coated,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """The sampled pixels from which empirical Bayes takes its prior.

    ``counts`` ``(3,)`` uint32 says how many have 1, 2 and 3 lobes (at most 32, 0: no prior),
    ``shapes`` ``(3, lobe, unknown, 32)`` the unknowns of their shapes and ``variances``
    ``(3, lobe, 32)`` the variances of these.
    """

    counts: NDArray[np.uint32]
    shapes: NDArray[np.float32]
    variances: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class LearnedLobes:
    """What the fit of a tile needs to know about the whole painting.

    Attributes
    ----------
    options
        Those of the fit; ``start`` is ``"multistart"`` where the sample was too small for seeds,
        ``bounded`` is False where it showed lobes that are broader.
    extent
        Rows and columns of the whole painting.
    middle
        Pixels that its middle lies right of and above the middle of a larger one, if the model is
        that of a part (``rig.origin``).
    pixels
        How many pixels were fitted to learn this: those of the finer grid, or, with
        ``start="multistart"``, up to ``TYPICAL_PIXELS`` spread over the sample.
    prior
        None with ``typical=False``.
    """

    options: LobeOptions
    extent: tuple[int, int]
    middle: tuple[float, float]
    pixels: int
    prior: Prior | None

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Everything as arrays by name, for an npz file."""
        options = {name: np.asarray(value) for name, value in asdict(self.options).items()}
        arrays = {name: np.asarray(getattr(self, name)) for name in ("extent", "middle", "pixels")}
        arrays |= options
        if self.prior is not None:
            arrays |= {name: getattr(self.prior, name) for name in Prior.__slots__}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> LearnedLobes:
        """The inverse of :meth:`to_arrays`.

        Raises
        ------
        ArgumentError
            If an array is missing or of another kind.
        """
        try:
            options = LobeOptions(**{name: arrays[name].item() for name in LobeOptions.__slots__})
            rows, columns = (int(size) for size in arrays["extent"])
            right, up = (float(offset) for offset in arrays["middle"])
            pixels = int(arrays["pixels"].item())
            prior = None
            if options.typical:
                prior = Prior(
                    counts=np.ascontiguousarray(arrays["counts"], dtype=np.uint32),
                    shapes=np.ascontiguousarray(arrays["shapes"], dtype=np.float32),
                    variances=np.ascontiguousarray(arrays["variances"], dtype=np.float32),
                )
        except (KeyError, ValueError, TypeError, AttributeError) as error:
            problem = f"learned: no saved lobes ({type(error).__name__}: {error})"
            raise ArgumentError(problem) from error
        return cls(options, (rows, columns), (right, up), pixels, prior)


def fit_lobes(
    stack: Stack,
    stereo: Normals,
    *,
    lobes: int,
    ambient: bool,
    index: float,
    threads: int | None,
    progress: bool | ProgressCallback,
    coated: bool = False,
    effort: Effort = PRESETS["standard"],
    typical: bool = True,
    sparing: bool = True,
    bounded: bool = True,
) -> LobeSbrdf:
    """Lobes of every pixel, from the maps of photometric stereo; see :func:`impasto.fit_sbrdf`.

    It is :func:`learn_lobes` and :func:`apply_lobes` in a row; ``coated``, ``typical``,
    ``sparing`` and ``bounded`` are those of :class:`LobeOptions`.
    """
    options = LobeOptions.of(
        effort,
        lobes=lobes,
        ambient=ambient,
        index=index,
        coated=coated,
        typical=typical,
        sparing=sparing,
        bounded=bounded,
    )
    maps = LobeMaps.empty(stack.shape[1], lobes, (stack.shape[2], stack.shape[3]))
    arguments = StackArguments.of(stack), StartArguments.of(stereo)
    with reporting(progress, "lobes") as callback:
        _core.fit_lobes(*arguments, options, maps, thread_count(threads), callback)
    return maps.result(stack, stereo, index, coated=coated)


def learn_lobes(
    stack: Stack,
    stereo: Normals,
    options: LobeOptions,
    *,
    extent: tuple[int, int] | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> LearnedLobes:
    """Learn what the fit of a tile needs to know about the whole painting.

    Parameters
    ----------
    stack, stereo
        The whole painting, or a part of it as a sample.
    extent
        Rows and columns of the whole painting. Default: those of the stack, which is then the whole
        of what is fitted, wherever it lies.
    """
    size = (stack.shape[2], stack.shape[3])
    extent = size if extent is None else extent
    middle = stack.rig.origin if extent == size else (0.0, 0.0)
    arguments = StackArguments.of(stack), StartArguments.of(stereo)
    with reporting(progress, "learning") as callback:
        found = _core.learn_lobes(
            *arguments, options, extent, middle, thread_count(threads), callback
        )
    prior = None if found["prior"] is None else Prior(**found["prior"])
    options = replace(options, start=found["start"], bounded=found["bounded"])
    return LearnedLobes(options, extent, middle, found["pixels"], prior)


def apply_lobes(
    learned: LearnedLobes,
    stack: Stack,
    stereo: Normals,
    *,
    inner: tuple[slice, slice] = (slice(None), slice(None)),
    out: LobeMaps | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> LobeMaps:
    """Fit the lobes of a tile with what was learned about the whole painting.

    The maps are those of the fit of the whole painting bit for bit, if ``learned`` is.

    Parameters
    ----------
    stack, stereo
        The tile's part of the painting; ``stack.rig.origin`` says where it lies. Where searches
        start from neighbours it must reach :data:`HALO` pixels farther than ``inner`` on every
        side, as far as the painting reaches.
    inner
        Rows and columns of the stack that are fitted. Default: all.
    out
        Arrays to be filled, of the size of ``inner``. Default: new ones.

    Raises
    ------
    GeometryError
        If the stack does not lie in the painting, or does not reach far enough.
    """
    rows, columns = (range(size)[part] for size, part in zip(stack.shape[2:], inner, strict=True))
    if not (rows and columns and rows.step == columns.step == 1):
        raise ArgumentError(f"inner: expected some rows and columns of the stack, found {inner}")
    size = len(rows), len(columns)
    maps = LobeMaps.empty(stack.shape[1], learned.options.lobes, size) if out is None else out
    arguments = StackArguments.of(stack), StartArguments.of(stereo)
    with reporting(progress, "lobes") as callback:
        _core.apply_lobes(
            learned,
            *arguments,
            (rows.start, columns.start),
            size,
            maps,
            thread_count(threads),
            callback,
        )
    return maps


def lobe_count(lobes: Any) -> int:
    """Lobes per pixel, checked."""
    if not (is_whole(lobes) and 1 <= lobes <= MOST_LOBES):
        raise ArgumentError(f"lobes: expected 1 to {MOST_LOBES} per pixel, found {lobes!r}")
    return int(lobes)
