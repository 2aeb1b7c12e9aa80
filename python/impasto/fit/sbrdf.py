"""``fit_sbrdf``: normals, diffuse colours and gloss from photographs, with every model."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack, overload

from numpy.typing import ArrayLike

from impasto._internal.calls import ProgressCallback
from impasto._internal.checks import truth
from impasto._internal.waiting import wait_for
from impasto.effort import EffortLike, resolved
from impasto.errors import ArgumentError
from impasto.fit.deferred import Deferred
from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.learning import learn_sbrdf
from impasto.fit.lobes import LobeSbrdf
from impasto.fit.normals import Method, Normals
from impasto.fit.options import Model, Pooling, fit_kinds
from impasto.fit.pooled import Extraction, PooledSbrdf
from impasto.fit.residuals import apply_residuals
from impasto.fit.result import Sbrdf
from impasto.fit.segments import SegmentSbrdf, checked_labels
from impasto.fit.stages import (
    Fitted,
    check_arguments,
    checked_normals,
    checked_options,
    chosen_kind,
    fit_of_kind,
    learned_relief,
    learned_residuals,
    relief_wanted,
    start_normals,
    with_refined_rig,
)
from impasto.fit.subsample import Sample
from impasto.io.results import read_maps, result_file
from impasto.stack import Stack, checked_stack

if TYPE_CHECKING:
    from xarray import Dataset

RESULTS: dict[str, type[Sbrdf]] = {
    kind.kind(): kind for kind in (PooledSbrdf, SegmentSbrdf, LobeSbrdf, LafortuneSbrdf)
}
"""Every kind of result, by the name in its files."""


def load_sbrdf(path: str | os.PathLike[str]) -> Sbrdf:
    """Read a result of :func:`fit_sbrdf` that its ``save`` wrote.

    Parameters
    ----------
    path
        The ``.npz`` or ``.zarr``, or the folder that ``impasto fit`` made.

    Raises
    ------
    CorruptInputError
        A file that is truncated, damaged or holds something else; the array is named.
    FileNotFoundError
        There is none.
    MissingExtraError
        A ``.zarr``, and zarr is not installed.
    """
    file = result_file(path)
    with read_maps(file, *RESULTS) as maps:
        return RESULTS[maps.kind].from_maps(maps)


class Common(TypedDict, total=False):
    """Options of every fit."""

    normals: Normals | Method | None
    refine: bool | None
    residuals: bool | None
    relief: bool | None
    check: bool
    effort: EffortLike
    threads: int | None
    progress: bool | ProgressCallback


class Pooled(Common, total=False):
    """Options of a fit that pools pixels."""

    extraction: Extraction
    peak: bool
    joint: bool
    coated: bool | None
    index: float


class Auto(Pooled, total=False):
    """Options of which some decide what is fitted."""

    segments: ArrayLike | None
    lobes: int | None
    ambient: bool | None


@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["torrance-sparrow"] = ...,
    pooling: Literal["none", "painting"],
    **options: Unpack[Pooled],
) -> PooledSbrdf: ...
@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["torrance-sparrow"] = ...,
    pooling: Literal["segment"],
    segments: ArrayLike,
    **options: Unpack[Pooled],
) -> SegmentSbrdf: ...
@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["torrance-sparrow"] = ...,
    pooling: Literal["pixel"],
    lobes: int | None = ...,
    ambient: bool = ...,
    coated: bool | None = ...,
    index: float = ...,
    **options: Unpack[Common],
) -> LobeSbrdf: ...
@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["lafortune"],
    pooling: Literal["auto", "pixel"] = ...,
    lobes: int | None = ...,
    **options: Unpack[Common],
) -> LafortuneSbrdf: ...
@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["torrance-sparrow"] = ...,
    pooling: Literal["auto"] = ...,
    **options: Unpack[Auto],
) -> PooledSbrdf | SegmentSbrdf | LobeSbrdf: ...
@overload
def fit_sbrdf(
    stack: Deferred, *, model: Model = ..., pooling: Pooling = ..., **options: Unpack[Auto]
) -> Dataset: ...
def fit_sbrdf(
    stack: Stack | Deferred,
    *,
    model: Model = "torrance-sparrow",
    pooling: Pooling = "auto",
    segments: ArrayLike | None = None,
    lobes: int | None = None,
    ambient: bool | None = None,
    coated: bool | None = None,
    extraction: Extraction | None = None,
    peak: bool | None = None,
    joint: bool | None = None,
    index: float | None = None,
    normals: Normals | Method | None = None,
    refine: bool | None = None,
    residuals: bool | None = None,
    relief: bool | None = None,
    check: bool = False,
    effort: EffortLike = "standard",
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Fitted | Dataset:
    """Estimate normals, diffuse colours and the gloss of a painting.

    The fit starts with photometric stereo. One (beta, gamma) for the painting is then fitted to the
    specular part of the samples by Levenberg-Marquardt (six-band paper eq. 6, RGB paper eq. 10).
    The papers stop here. With ``joint``, the lobe, every normal and all colours are then fitted
    together to all samples. This removes errors that highlights caused in normals, and scattered
    normals no longer widen the lobe. Robust scales of the residuals limit the influence of shadows
    and of pixels that the model does not describe.

    By default held-out photographs decide whether the painting has one lobe or every pixel its own,
    how many, whether ambient light is part of the model, and whether diffuse light crosses a
    varnish (``pooling="auto"``); ``chosen`` of the result says what was chosen, and against what.

    With ``pooling="pixel"`` every pixel has its own lobes, each with a width and a strength per
    band, and its normal is fitted with them. This is for gilding, metal leaf, and varnish that
    varies over the painting. It needs many lights (about 20 or more). A pixel has only as many
    lobes as its photographs support (``lobes``).

    ``model="lafortune"`` fits every pixel in the three passes of the third paper: the normal, by a
    cosine lobe with a diffuse term on the mean of the bands; Lafortune lobes on that mean, added
    one at a time while Schwarz's criterion (BIC) decreases; the colours of all terms in each band,
    by non-negative least squares. It is made for hundreds of photographs with different views.
    Clipped samples are not used.

    Parameters
    ----------
    stack
        Photographs with their lights. Of a :class:`LazyStack` the result is an
        ``xarray.Dataset`` of lazy maps.
    model
        ``"torrance-sparrow"`` of the first two papers, or ``"lafortune"`` of the third.
    pooling
        ``"auto"`` (default): the fit that predicts held-out photographs of some 1000 sampled pixels
        best, of those that have all given options: ``joint`` and ``extraction`` ask for
        ``"painting"``, ``lobes`` and ``ambient`` for ``"pixel"``, ``segments`` for ``"segment"``,
        ``coated`` for one of the first two.
        With fewer than 8 photographs it is ``"painting"``. Of a painting of more than two million
        pixels everything that all of them share is learned from every third (fifth, seventh ...)
        row and column, as by :func:`learn_sbrdf`, unless there are segments, the normals are maps,
        or the stack is a part of another; ``learn_sbrdf(stack, sample=1).apply(stack)`` learns from
        all pixels.
        ``"none"``: photometric stereo alone, no gloss.
        ``"painting"``: one Torrance-Sparrow lobe for all pixels. ``"segment"``: one for
        each part in ``segments``; a part whose pixels do not determine a lobe has the painting's
        (``Segment.own``). ``"pixel"``: lobes of every pixel; always so for Lafortune lobes.
    segments
        With ``pooling="segment"``: ``(y, x)`` whole numbers, the same for the pixels of one part;
        below 0, or masked by numpy: no part. All parts together take at most two to three times as
        long as the painting alone. With about 20 lights or more, ``pooling="pixel"`` shows more
        detail.
    lobes
        With lobes per pixel: their largest number, 1 to 3; default: 2, with Lafortune lobes 3.
    ambient
        With ``pooling="pixel"``: whether every pixel has a constant per band for light that does
        not depend on the lamp's direction, as between the facets of a relief; default: True.
    coated
        With one lobe per painting (``joint``) or lobes per pixel: whether diffuse light crosses a
        smooth interface of index ``index`` on its way to the paint and back, as in varnished
        paintings: ``N.L`` is then multiplied by ``t(N.L) t(N.V)``,
        ``t(c) = (1 - F(c)) / (1 - F(1))`` with Fresnel's reflectance F (Wolff 1994). Steep flanks
        of varnished paint are darker than Lambert's law says; of bare paint they are not. Default:
        with ``pooling="auto"`` held-out photographs decide, else False.
    index
        Index of refraction of a Torrance-Sparrow lobe's interface; default: 1.45, as in the papers.
    normals
        The result of :func:`impasto.fit_normals`, or the name of one of its methods; default: its
        default method. Pixels outside the mask of the stack are not fitted.
    refine
        Whether the rig is refined first by :func:`impasto.refine_rig`, which takes some seconds
        whatever the size of the picture: distances of camera and lamps and strengths of lamps,
        accepted only where held-out photographs are predicted better. ``rig`` of the result is the
        refined one, and its ``refinement`` says what was accepted. Default: with
        ``pooling="auto"`` and 24 photographs or more from one view, unless the rig was refined
        before or ``normals`` are maps.
    residuals
        Whether to keep what the model leaves of the photographs, for new lights seen from the same
        view: by kriging, if held-out photographs are then predicted better. Default: where
        ``pooling="auto"`` has chosen. Not with ``segments``, and never from several views.
    relief
        Whether to model the painting's own cast shadows and interreflections, where held-out
        photographs are then predicted better: heights are integrated from the normals, light that
        came from other places is taken off the samples, and the fit is repeated
        (:doc:`models`). ``relief`` of the result is what :meth:`Sbrdf.predict` needs of it.
        Default: where ``pooling="auto"`` has chosen. Not with ``segments`` or normals that are
        maps, and never from several views.
    check
        Whether to refuse a stack whose lights are mirrored, rotated or exchanged, or that has a
        photograph twice (:func:`impasto.doctor.before_fit`); default: False. The command line
        checks every stack.
    effort
        ``"draft"``, ``"standard"``, ``"reference"`` or an :class:`Effort`: accuracy against time.
    threads
        None means every allowed core.
    progress
        True: a bar on stderr; or a callable ``(done, total)`` in tiles, which starts again for each
        of the two stages, and with segments for every segment.

    Returns
    -------
    PooledSbrdf
        Maps and the lobe. ``pooling="segment"`` returns a :class:`SegmentSbrdf` with one lobe per
        part, ``pooling="pixel"`` a :class:`LobeSbrdf` with maps of the lobes of every pixel, and
        ``model="lafortune"`` a :class:`LafortuneSbrdf`.

    Raises
    ------
    ArgumentError
        An unknown name, an option that the fit does not have, an index outside 1 to 100, lobes
        outside 1 to 3, joint, peak, ambient, coated or relief neither True nor False,
        ``relief=True`` with segments or normals that are maps, normals of another size, segments
        that are no whole numbers ``(y, x)``, or with ``check`` a stack to be repaired first.
    GeometryError
        Lights that cannot determine normals, or views from behind alone.

    References
    ----------
    S. Tominaga and N. Tanaka, papers on measuring and rendering art paintings by an RGB camera
    (eq. 9, 10) and by a six-band camera (eq. 1, 6). E. Snel, J. Heuberger, W. Pasman and
    E. Jansen, Acquisition and rendering of paintings (section 4). L. B. Wolff, Diffuse-reflectance
    model for smooth dielectric surfaces, J. Opt. Soc. Am. A 11, 1994. E. Lafortune et al.,
    Non-linear approximation of reflectance functions, SIGGRAPH 1997.
    """
    if isinstance(stack, Deferred):
        options = {name: value for name, value in locals().items() if name != "stack"}
        return stack.fitted_sbrdf(**options)
    checked_stack(stack)
    method = normals if isinstance(normals, str) else None
    check_arguments(method, residuals, threads, progress)
    relief = None if relief is None else truth(relief, "relief")
    if truth(check, "check"):
        from impasto.doctor.before_fit import before_fit, refuse_faults

        refuse_faults(wait_for(before_fit, stack))
    given: dict[str, Any] = {
        "segments": segments,
        "lobes": lobes,
        "ambient": ambient,
        "coated": coated,
        "extraction": extraction,
        "peak": peak,
        "joint": joint,
        "index": index,
    }
    effort = resolved(effort)
    maps = normals is not None and not isinstance(normals, str)
    if maps:
        checked_normals(normals, stack)
    kinds = fit_kinds(model, pooling, given)
    whole = segments is None and pooling != "segment" and stack.rig.origin == (0.0, 0.0)
    if whole and not maps and Sample.of(stack).stride > 1:
        del given["segments"]
        given |= {"normals": normals, "refine": refine, "residuals": residuals, "relief": relief}
        given |= {"effort": effort, "threads": threads, "progress": progress}
        learned = learn_sbrdf(stack, model=model, pooling=pooling, **given)
        return learned.apply(stack, threads=threads, progress=progress)
    stack = with_refined_rig(stack, kinds, given, refine, maps=maps, threads=threads)
    chosen = chosen_kind(stack, kinds, given, normals, residuals, threads, progress)
    choice, kind, _ = chosen
    checked_options(*chosen[1:])
    found = None
    if relief and (maps or "segments" in kind.defaults):
        beside = "normals that are maps" if maps else "segments"
        raise ArgumentError(f"relief: a fit with {beside} has none; leave one of them out")
    if not maps and "segments" not in kind.defaults and relief_wanted(relief, choice):
        found, chosen = learned_relief(stack, kinds, given, chosen, normals, residuals, threads)
    choice, kind, given = chosen
    options = checked_options(kind, given)
    labels = None
    if "segments" in options:
        labels = wait_for(checked_labels, options.pop("segments"), stack.shape[2:])
    wanted = choice is not None if residuals is None else truth(residuals, "residuals")
    if wanted and labels is not None:
        raise ArgumentError("residuals: a fit with segments keeps none; leave one of them out")
    photographs = stack
    if found is not None:
        stack = found.removed(stack, threads=threads)
    stereo = start_normals(stack, normals, effort, threads, progress)
    options |= {"effort": effort, "threads": threads, "progress": progress}
    result = fit_of_kind(stack, kind, stereo, options, labels)
    result = replace(result, chosen=choice, relief=found)
    if wanted:
        process = learned_residuals(photographs, kind, given, normals, threads, found)
        if process is not None:
            kept = apply_residuals(process, photographs, result, threads=threads)
            result = replace(result, residuals=kept)
    return result
