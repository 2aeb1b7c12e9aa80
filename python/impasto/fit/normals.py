"""Photometric stereo: every pixel's normal and albedo from photographs under known lights."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeVar, Unpack, get_args, overload

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import StackArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import instance, is_whole, one_of
from impasto.effort import EffortLike, resolved
from impasto.errors import ArgumentError, GeometryError
from impasto.fit.deferred import Deferred
from impasto.fit.partial_normals import (
    NormalMap,
    PartialNormals,
    chosen_maps,
    cleared,
    partial_normals,
)
from impasto.fit.pixel_maps import PixelMaps
from impasto.fit.saved import over
from impasto.fit.subsample import subsampled_to
from impasto.stack import Stack
from impasto.status import Status

if TYPE_CHECKING:
    from xarray import Dataset

Method = Literal[
    "robust", "least-squares", "threshold", "rank", "trimmed", "l1", "huber", "cauchy", "tukey"
]
METHODS: tuple[Method, ...] = get_args(Method)
"""Methods of :func:`fit_normals`."""

MOST_STEPS = 1000

LEARNED_PIXELS = 1 << 10
"""Most pixels that :func:`learn_normals` looks at: they leave 4 % of error in the scale."""


@dataclass(frozen=True)
class LearnedNormals:
    """What ``fit_normals(method="robust")`` must know of a whole painting.

    Parameters
    ----------
    scale
        Median over the pixels of the residuals' scale relative to the pixel's brightness, to four
        binary digits.
    correlation
        Correlation of the residuals between each light and its three nearest, 0 to 1 in steps of
        1/32, beyond what noise has: 0 where the residuals are noise, up to a half where the surface
        is not as the model has it.
    """

    scale: float
    correlation: float


@dataclass(frozen=True, eq=False, repr=False)
class Normals(PixelMaps):
    """Normals and albedo with their errors.

    Maps are NaN where ``status`` is 16 or more; ``residual`` and ``sigma`` also where it is
    ``EXACT``. The albedo of a ``DARK`` pixel is 0.

    Parameters
    ----------
    normal
        ``(3, y, x)`` float32 unit vectors: x right, y up, z towards the viewer.
    albedo
        ``(band, y, x)`` float32, diffuse reflectance relative to the white board.
    used
        ``(y, x)`` uint16, number of samples that the result uses.
    rejected
        ``(4, y, x)`` uint16, number of samples not used, by reason: saturated, invalid, shadow,
        highlight. With ``used`` the sum is the number of observations (all 0 outside the mask).
    residual
        ``(y, x)`` float32, root mean square of the used samples' residuals, linear light.
    condition
        ``(y, x)`` float32, condition number of the matrix whose rows are the directions of the
        used lights (times the irradiance of near ones): half a percent of noise tilts the normal
        by about 0.1 degree times this number.
    sigma
        ``(y, x)`` float32, predicted standard deviation of the normal along its worst axis, rad:
        68 % of errors along that axis are smaller where the noise is normal. With ``"robust"`` it
        contains errors of the model: what gloss, varnish and light from other surfaces do to it, as
        far as residuals and shadows show it.
    status
        ``(y, x)`` uint8, see :class:`~impasto.Status`.
    method
        The method of :func:`fit_normals`.
    """

    normal: NDArray[np.float32] = field(metadata=over("axis", "y", "x"))
    albedo: NDArray[np.float32] = field(metadata=over("band", "y", "x"))
    used: NDArray[np.uint16] = field(metadata=over("y", "x", dtype=np.uint16))
    rejected: NDArray[np.uint16] = field(metadata=over("reason", "y", "x", dtype=np.uint16))
    residual: NDArray[np.float32] = field(metadata=over("y", "x"))
    condition: NDArray[np.float32] = field(metadata=over("y", "x"))
    sigma: NDArray[np.float32] = field(metadata=over("y", "x", unit="rad"))
    status: NDArray[np.uint8] = field(metadata=over("y", "x", dtype=np.uint8))
    method: str = field(metadata=over(dtype=np.str_))

    def within(self, mask: NDArray[np.bool_]) -> Normals:
        """The same normals inside ``mask (y, x)``; pixels outside become ``MASKED``.

        The result is that of a fit to photographs with this mask.
        """
        outside = ~mask
        if not outside.any():
            return self
        known = ("normal", "albedo", "residual", "condition", "sigma")
        nothing: dict[str, Any] = {
            **dict.fromkeys(known, np.float32(np.nan)),
            **dict.fromkeys(("used", "rejected"), np.uint16(0)),
            "status": np.uint8(Status.MASKED),
        }
        maps = {name: np.where(outside, no, getattr(self, name)) for name, no in nothing.items()}
        return replace(self, **maps)

    def __repr__(self) -> str:
        height, width = self.status.shape
        share = float((self.status < Status.DARK).mean())
        return (
            f"<Normals {width} x {height} pixels, {len(self.albedo)} bands, {self.method}, "
            f"{100 * share:.1f} % estimated>"
        )

    def _repr_html_(self) -> str:
        """HTML for notebooks: size, method, predicted error, albedo and normals."""
        from impasto.notebook import normals_view

        return normals_view(self)


class StereoOptions(TypedDict, total=False):
    """Options of :func:`fit_normals`."""

    method: Method
    low: float
    high: float
    w1: float
    w2: float
    steps: int | None
    selection: int | str | None
    learned: LearnedNormals | None
    effort: EffortLike
    threads: int | None
    progress: bool | ProgressCallback


Out = TypeVar("Out", Normals, PartialNormals)


@overload
def fit_normals(stack: Stack, *, out: Out, **options: Unpack[StereoOptions]) -> Out: ...
@overload
def fit_normals(
    stack: Stack, *, maps: Iterable[NormalMap], **options: Unpack[StereoOptions]
) -> PartialNormals: ...
@overload
def fit_normals(stack: Stack, **options: Unpack[StereoOptions]) -> Normals: ...
@overload
def fit_normals(stack: Deferred, **options: Unpack[StereoOptions]) -> Dataset: ...
def fit_normals(
    stack: Stack | Deferred,
    *,
    method: Method = "robust",
    low: float = 0.2,
    high: float = 0.8,
    w1: float = 1.2,
    w2: float = 0.1,
    steps: int | None = None,
    selection: int | str | None = None,
    learned: LearnedNormals | None = None,
    effort: EffortLike = "standard",
    maps: Iterable[NormalMap] | None = None,
    out: Normals | PartialNormals | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Normals | PartialNormals | Dataset:
    """Fit the normal and the albedo of every pixel by photometric stereo.

    A matte surface reflects ``I_i = albedo (N . l_i)`` under light i (RGB-camera paper, eq. 2). The
    equations of the samples that are neither highlight nor shadow are solved by least squares.
    Every method first excludes samples that are clipped or missing in any band. Near lights have
    their own direction and fall-off at every pixel.

    Parameters
    ----------
    stack
        At least three photographs whose lights do not lie in one plane. Of a :class:`LazyStack`
        the result is an ``xarray.Dataset`` of lazy maps.
    method
        How highlights and shadows are excluded, or weighted less:

        - ``"robust"``: MM-estimation (Yohai 1987): of four fits, to all samples and to three
          ranges of ranks, the one with the smallest scale of residuals starts steps of Tukey's
          biweight, ``(1 - (R / 2 s)^2)^2``. Where a Hausman test (Hausman 1978) finds no evidence
          against least squares, as on matte pixels, the result is that of ``"least-squares"``;
        - ``"least-squares"``: none;
        - ``"threshold"``: the papers' rule (RGB-camera paper, section 3.2): a sample whose mean
          over the bands exceeds ``w1`` times the pixel's mean over the lights is highlight, one
          below ``w2`` times is shadow;
        - ``"rank"``: of n samples keep those of rank ``int(low * n) <= rank < round(high * n)``
          in order of brightness, ties by the order of the lights;
        - ``"trimmed"``: ``"rank"``, then five steps of ``"l1"`` on the samples that it keeps;
        - ``"l1"``, ``"huber"``, ``"cauchy"``, ``"tukey"``: weights from the residuals R,
          iterated: ``1 / |R|``, ``min(1, 1.345 s / |R|)``, ``1 / (1 + (R / 2.385 s)^2)``,
          ``(1 - (R / 4.685 s)^2)^2`` within ``4.685 s``; s is 1.4826 times the median of ``|R|``.

        Where a method leaves fewer than four samples, rejected samples of middle rank are used
        again (status ``RELAXED``).
    low, high
        Limits of ``"rank"`` and ``"trimmed"``, as shares of the samples from dark to bright; a
        glossy painting needs a higher ``low``.
    w1, w2
        Thresholds relative to the pixel's mean.
    steps
        Steps of reweighting; default: those of the effort for ``"robust"`` and ``"trimmed"``, 30
        for ``"l1"``, 20 for the others.
    selection
        The band (its name or number) that normals are solved from, ``"green"`` in the papers;
        default: the mean of the bands. Highlights and shadows are always detected on the mean.
    learned
        For ``"robust"``: what :func:`learn_normals` learned of the whole painting, of which the
        stack is a part; its pixels are then those of a fit to the whole, bit by bit. Default: it is
        learned from this stack.
    effort
        ``"draft"``, ``"standard"``, ``"reference"`` or an :class:`Effort`.
    maps
        Names of the maps that are needed, such as ``("normal",)``, of ``"normal"``, ``"albedo"``,
        ``"used"``, ``"rejected"``, ``"residual"``, ``"condition"`` and ``"sigma"``; default: all.
        Least squares mostly waits for memory: normals alone take about three quarters of its time.
        Not for a :class:`LazyStack`, which computes the maps that are used.
    out
        The result of an earlier fit to a stack of this size, whose maps are written again: of new
        memory the system first fills every page with zeros. It then holds the new maps, and no
        longer those of the earlier fit. Without ``maps``: the maps are those that ``out`` has.
    threads, progress
        None means every allowed core; a bool or a callable ``(done, total)``.

    Returns
    -------
    Normals
        Maps of the photographs' height and width. With ``maps`` a :class:`PartialNormals`; with
        ``out`` one of the same kind in the same memory.

    Raises
    ------
    GeometryError
        If there are fewer than three lights, or all of them lie in one plane or behind the
        painting.
    ArgumentError
        An option that is not valid; the message names it.
    """
    if isinstance(stack, Deferred):
        given = dict(locals())
        del given["stack"]
        for name in ("maps", "out"):
            if given.pop(name) is not None:
                raise ArgumentError(
                    f"{name}: a lazy stack computes the maps of the dataset that are used, when "
                    f"they are; leave {name} out"
                )
        return stack.fitted_normals(**given)
    one_of(method, METHODS, "method")
    steps = None if steps is None else _steps(steps)
    effort = resolved(effort)
    if steps is None and method in {"robust", "trimmed"}:
        steps = effort.stereo
    if learned is not None:
        instance(learned, LearnedNormals, "learned", "what impasto.learn_normals returned")
    arguments = StackArguments.of(stack)
    _check_side(stack)
    band = _band(stack, selection)
    if method == "robust" and learned is None and steps is not None:
        learned = _learned(stack, steps, band, threads, arguments)
    normals = _memory(stack, method, maps, out)
    with reporting(progress, "normals") as callback:
        _core.fit_normals(
            arguments,
            normals,
            method,
            _number(low, "low"),
            _number(high, "high"),
            _number(w1, "w1"),
            _number(w2, "w2"),
            steps,
            band,
            (0.0, 0.0) if learned is None else (learned.scale, learned.correlation),
            thread_count(threads),
            callback,
        )
    return normals


def learn_normals(
    stack: Stack,
    *,
    steps: int | None = None,
    selection: int | str | None = None,
    effort: EffortLike = "standard",
    threads: int | None = None,
) -> LearnedNormals:
    """Learn what ``fit_normals`` must know of a whole painting, for fitting it tile by tile.

    Every pixel of ``fit_normals(tile, learned=learn_normals(whole))`` is bit-identical to that of
    ``fit_normals(whole)``.

    Parameters
    ----------
    stack
        The whole painting, or a sample of it. At most 1024 pixels at a regular stride are used.
    steps, selection, effort, threads
        As in :func:`fit_normals`.

    Returns
    -------
    LearnedNormals
        For ``fit_normals(tile, learned=)``.

    Raises
    ------
    GeometryError, ArgumentError
        As :func:`fit_normals`.
    """
    steps = resolved(effort).stereo if steps is None else _steps(steps)
    _check_side(stack)
    return _learned(stack, steps, _band(stack, selection), threads)


def _learned(
    stack: Stack,
    steps: int,
    band: int | None,
    threads: int | None,
    arguments: StackArguments | None = None,
) -> LearnedNormals:
    """What is learned from a stack, whose ``arguments`` may be known."""
    sample = subsampled_to(stack, LEARNED_PIXELS)
    if arguments is None or sample is not stack:
        arguments = StackArguments.of(sample)
    scale, correlation = _core.learn_normals(arguments, steps, band, thread_count(threads))
    return LearnedNormals(scale, correlation)


def _steps(steps: int) -> int:
    if not (is_whole(steps) and 0 <= steps <= MOST_STEPS):
        raise ArgumentError(f"steps: expected a number from 0 to {MOST_STEPS}, found {steps!r}")
    return int(steps)


def _memory(
    stack: Stack,
    method: str,
    maps: Iterable[NormalMap] | None,
    out: Normals | PartialNormals | None,
) -> Normals | PartialNormals:
    """The maps to be filled: new ones, or those of ``out``."""
    if out is None:
        if maps is None:
            return _empty(stack, method)
        return partial_normals(stack.shape, method, chosen_maps(maps))
    if maps is not None:
        raise ArgumentError("maps: out has the maps that are made; give one of the two")
    if not isinstance(out, Normals | PartialNormals):
        raise ArgumentError(
            f"out: expected the result of an earlier fit_normals, found {type(out).__name__}"
        )
    cleared(out, stack.shape)
    return replace(out, method=method)


def _empty(stack: Stack, method: str) -> Normals:
    """Maps to be filled, in three pieces of memory.

    Counts of rejected samples and statuses are written only where they are not zero: memory that
    the system hands out as zeros is not touched where nothing goes wrong.
    """
    _, bands, height, width = stack.shape
    planes = np.empty((bands + 6, height, width), dtype=np.float32)
    counts = np.zeros((5, height, width), dtype=np.uint16)
    return Normals(
        normal=planes[:3],
        albedo=planes[3 : bands + 3],
        used=counts[0],
        rejected=counts[1:],
        residual=planes[bands + 3],
        condition=planes[bands + 4],
        sigma=planes[bands + 5],
        status=np.zeros((height, width), dtype=np.uint8),
        method=method,
    )


def _check_side(stack: Stack) -> None:
    depth = stack.rig.directions[:, 2]
    if not (depth > 0.0).any():
        raise GeometryError(
            f"lights: all {len(depth)} lights lie behind the painting (z <= 0, highest "
            f"{depth.max():.3g}), where they reach no front; z points to the viewer: check the "
            "order of the axes and the sign of z"
        )


def _number(value: float, name: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name}: expected a number, found {value!r}") from error


def _band(stack: Stack, selection: int | str | None) -> int | None:
    """The number of a band given by number or name."""
    if selection is None:
        return None
    if isinstance(selection, str):
        if selection in stack.bands:
            return stack.bands.index(selection)
    elif is_whole(selection) and -len(stack.bands) <= selection < len(stack.bands):
        return int(selection) % len(stack.bands)
    bands = ", ".join(f'"{band}"' for band in stack.bands)
    raise ArgumentError(
        f"selection: expected a band ({bands}), its number or None, found {selection!r}"
    )
