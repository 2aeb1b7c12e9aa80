"""``fit_sbrdf``: normals, diffuse colours and gloss from photographs, with every model."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, Unpack, get_args, overload

from numpy.typing import ArrayLike

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import ProgressCallback
from impasto._internal.checks import one_of, refractive_index, truth
from impasto._internal.waiting import wait_for
from impasto.effort import Effort, EffortLike, resolved
from impasto.errors import ArgumentError
from impasto.fit.choice import CANDIDATES, Candidate, Choice, choose
from impasto.fit.deferred import Deferred
from impasto.fit.lafortune import LafortuneSbrdf, fit_lafortune
from impasto.fit.learned_relief import (
    JUDGED,
    Fit,
    Reduced,
    learn_relief,
    learn_white,
    reduced,
    relief_sample,
    with_relief,
)
from impasto.fit.lobes import LobeSbrdf, fit_lobes, lobe_count
from impasto.fit.normals import LearnedNormals, Method, Normals, fit_normals
from impasto.fit.options import FitKind, Model, Pooling, fit_kind, fit_kinds
from impasto.fit.pooled import Extraction, PooledSbrdf, fit_pooled, without_gloss
from impasto.fit.relief import Relief
from impasto.fit.residuals import (
    LearnedResiduals,
    apply_residuals,
    learn_residuals,
    usual_residuals,
)
from impasto.fit.result import Sbrdf
from impasto.fit.rig_refinement import refined
from impasto.fit.segments import SegmentSbrdf, checked_labels, fit_segments
from impasto.io.results import read_maps, result_file
from impasto.rig import seen_from_front
from impasto.stack import Stack, checked_stack

if TYPE_CHECKING:
    from xarray import Dataset

RESULTS: dict[str, type[Sbrdf]] = {
    kind.kind(): kind for kind in (PooledSbrdf, SegmentSbrdf, LobeSbrdf, LafortuneSbrdf)
}
"""Every kind of result, by the name in its files."""
Chosen: TypeAlias = tuple[Choice | None, FitKind, dict[str, Any]]
"""How a fit was chosen, the fit and its options."""


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
) -> PooledSbrdf | SegmentSbrdf | LobeSbrdf | LafortuneSbrdf | Dataset:
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
        ``"auto"`` (default): the fit that predicts held-out photographs of some 2000 sampled pixels
        best, of those that have all given options: ``joint`` and ``extraction`` ask for
        ``"painting"``, ``lobes`` and ``ambient`` for ``"pixel"``, ``segments`` for ``"segment"``,
        ``coated`` for one of the first two.
        With fewer than 8 photographs it is ``"painting"``.
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
        Whether the rig is refined first by :func:`impasto.refine_rig`, which takes 2 to 30 s
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
        given = {name: value for name, value in locals().items() if name != "stack"}
        return stack.fitted_sbrdf(**given)
    checked_stack(stack)
    relief = None if relief is None else truth(relief, "relief")
    if truth(check, "check"):
        from impasto.doctor.before_fit import refuse_faults

        wait_for(refuse_faults, stack)
    given = {
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

    def pooled(stereo: Normals) -> PooledSbrdf:
        return fit_pooled(stack, stereo, **options)

    result: PooledSbrdf | SegmentSbrdf | LobeSbrdf | LafortuneSbrdf
    if model == "lafortune":
        result = fit_lafortune(stack, stereo, **options)
    elif kind.pooling == "none":
        result = without_gloss(stack, stereo)
    elif "lobes" in options:
        result = fit_lobes(stack, stereo, **options)
    else:
        result = pooled(stereo) if labels is None else fit_segments(labels, stereo, pooled)
    result = replace(result, chosen=choice, relief=found)
    if wanted:
        learned = learned_residuals(photographs, kind, given, normals, threads, found)
        kept = None if learned is None else apply_residuals(learned, photographs, result)
        result = replace(result, residuals=kept)
    return result


def relief_wanted(relief: bool | None, choice: Choice | None) -> bool:
    """Whether a relief is looked for; by default where something was chosen."""
    return choice is not None if relief is None else relief


def learned_relief(
    stack: Stack,
    kinds: Sequence[FitKind],
    given: Mapping[str, Any],
    chosen: Chosen,
    normals: Normals | Method | None,
    residuals: bool | None,
    threads: int | None,
) -> tuple[Relief | None, Chosen]:
    """The relief of a fit, from held-out photographs, and the fit with it; None: it does not help.

    Interreflections are a varnish or ambient light to fits that do not know them: where the choice
    is open, it is made again without them.
    """
    alone = _plain_fit(*chosen[1:], normals, threads)
    few = relief_sample(stack, alone, threads=threads)
    if few is None:
        return None, chosen
    # A fit without gloss takes least time, and takes no light of the surroundings for its own.
    bare = next((kind for kind in kinds if kind.pooling == "none"), chosen[1])
    matte = _plain_fit(bare, chosen[2], normals, threads)
    white = learn_white(few, matte, threads=threads)
    if white is None:
        return None, chosen
    again, fits = chosen, [alone]
    if len(kinds) > 1:
        again = chosen_kind(
            stack, kinds, given, normals, residuals, threads, False, before=(few, alone, white)
        )
        if again[1:] != chosen[1:]:
            fits.append(_plain_fit(*again[1:], normals, threads))
    found = learn_relief(stack, few, fits, white, threads=threads)
    if found is None:
        return None, chosen
    relief, fit = found
    return relief, chosen if fit is alone else again


def learned_residuals(
    stack: Stack,
    kind: FitKind,
    given: Mapping[str, Any],
    normals: Normals | Method | None,
    threads: int | None,
    relief: Relief | None,
) -> LearnedResiduals | None:
    """The process of a fit's residuals, from held-out photographs; None if it does not help.

    With a relief they are those of reduced photographs, each fit with a relief of its own.
    """
    fit = _plain_fit(kind, given, normals, threads)
    if relief is None:
        return learn_residuals(stack, fit, threads=threads)

    def with_its_own(known: Stack) -> Sbrdf:
        white = relief.white if relief.interreflection else None
        result: Sbrdf = with_relief(known, fit, white, threads=threads)
        return result

    few = reduced(stack, JUDGED)
    return learn_residuals(stack, with_its_own, part=few.stack, truth=few.truth, threads=threads)


def _plain_fit(
    kind: FitKind,
    given: Mapping[str, Any],
    normals: Normals | Method | None,
    threads: int | None,
) -> Fit:
    """A fit to some photographs, without what is learned from those that are held out."""
    method = normals if isinstance(normals, str) else None
    options: dict[str, Any] = {name: given.get(name) for name in kind.defaults}
    options |= {"model": kind.model, "pooling": kind.pooling, "normals": method}
    options |= {"refine": False, "residuals": False, "relief": False, "threads": threads}

    def fit(known: Stack) -> Sbrdf:
        result: Sbrdf = fit_sbrdf(known, **options)
        return result

    return fit


def with_refined_rig(
    stack: Stack,
    kinds: Sequence[FitKind],
    given: Mapping[str, Any],
    refine: bool | None,
    *,
    maps: bool,
    threads: int | None,
) -> Stack:
    """The stack with the rig that a fit of one of these kinds uses; ``maps``: of given normals."""
    for kind in kinds:
        checked_options(kind, given)
    seen_from_front(stack.rig)
    index = given.get("index")
    return refined(
        stack,
        refine,
        open_choice=len(kinds) > 1 and not maps,
        index=1.45 if index is None else refractive_index(index),
        threads=threads,
    )


def chosen_kind(
    stack: Stack,
    kinds: Sequence[FitKind],
    given: Mapping[str, Any],
    normals: Normals | Method | None,
    residuals: bool | None,
    threads: int | None,
    progress: bool | ProgressCallback,
    *,
    before: tuple[Reduced, Fit, float] | None = None,
) -> Chosen:
    """The fit among ``kinds``, its options, and how it was chosen; None where nothing was open.

    Fits whose residuals will be kept are compared with those. After ``before``, all have the
    relief that its fit with its white finds in some of its reduced photographs.
    """
    if len(kinds) == 1:
        return None, kinds[0], dict(given)
    # Normals of all photographs know those that are held out.
    method = normals if isinstance(normals, str) else None

    @cache
    def around(known: Stack) -> Relief | None:
        return None if before is None else Relief.of(before[1](known), 1, before[2])

    def fit(known: Stack, candidate: Candidate) -> Sbrdf:
        options: dict[str, Any] = {**given, **candidate.options}
        options |= {"normals": method, "refine": False, "residuals": False, "relief": False}
        relief = around(known)
        seen = known if relief is None else relief.removed(known, threads=threads)
        result: Sbrdf = fit_sbrdf(seen, **options, threads=threads)
        result = replace(result, relief=relief)
        return replace(result, residuals=usual_residuals(known, result)) if kept else result

    kept = residuals is not False and not _core.views_differ(RigArguments.of(stack.rig))
    poolings = {kind.pooling for kind in kinds}
    candidates = [one for one in CANDIDATES if one.pooling in poolings]
    coated = given.get("coated")
    if coated is not None:
        candidates = [replace(one, coated=coated) for one in candidates if not one.coated]
    choice = choose(
        stack,
        candidates,
        fit,
        open_varnish=coated is None,
        part=None if before is None else before[0].stack,
        truth=None if before is None else before[0].truth,
        threads=threads,
        progress=progress,
    )
    chosen = dict(choice.best.options)
    kind = fit_kind(kinds[0].model, chosen.pop("pooling"))
    return choice, kind, {**given, **chosen}


def checked_options(kind: FitKind, given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a fit, each checked; defaults where None is given."""
    options = kind.complete(given)
    if "extraction" in options:
        one_of(options["extraction"], get_args(Extraction), "extraction")
    if "index" in options:
        options["index"] = refractive_index(options["index"])
    for name in ("joint", "peak", "ambient", "coated"):
        if name in options:
            options[name] = truth(options[name], name)
    if "lobes" in options:
        options["lobes"] = lobe_count(options["lobes"])
    if options.get("coated") and not options.get("joint", True):
        raise ArgumentError(
            "coated: joint=False keeps the colours of photometric stereo, which know no varnish; "
            "leave one of them out"
        )
    return options


def start_normals(
    stack: Stack,
    normals: Normals | Method | None,
    effort: Effort,
    threads: int | None,
    progress: bool | ProgressCallback,
    learned: LearnedNormals | None = None,
) -> Normals:
    """The maps of photometric stereo that a fit begins with."""
    if normals is None or isinstance(normals, str):
        options: dict[str, Any] = {} if normals is None else {"method": normals}
        options |= {"learned": learned, "effort": effort, "threads": threads}
        return fit_normals(stack, **options, progress=progress)
    checked_normals(normals, stack)
    return normals if stack.mask is None else wait_for(normals.within, stack.mask)


def checked_normals(normals: Any, stack: Stack) -> None:
    """Refuse what are no normals of this stack."""
    if not isinstance(normals, Normals):
        raise ArgumentError(
            "normals: expected what impasto.fit_normals returns, the name of one of its methods "
            f"or None, found {type(normals).__name__}"
        )
    _, bands, height, width = stack.shape
    if normals.albedo.shape != (bands, height, width):
        raise ArgumentError(
            f"normals: their albedo has the shape {normals.albedo.shape}, the stack needs "
            f"{(bands, height, width)}; fit them to this stack"
        )
