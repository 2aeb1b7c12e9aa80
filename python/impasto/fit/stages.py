"""The stages of a fit: rig, choice, relief, photometric stereo, gloss and residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, TypeAlias, get_args

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import ProgressCallback, check_progress, thread_count
from impasto._internal.checks import one_of, refractive_index, truth
from impasto._internal.waiting import wait_for
from impasto.effort import Effort, resolved
from impasto.errors import ArgumentError
from impasto.fit.choice import CANDIDATES, Candidate, Choice, choose
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
from impasto.fit.normals import METHODS, LearnedNormals, Method, Normals, fit_normals
from impasto.fit.options import FitKind, fit_kind
from impasto.fit.partial_normals import PartialNormals
from impasto.fit.pooled import Extraction, PooledSbrdf, fit_pooled, without_gloss
from impasto.fit.relief import Relief
from impasto.fit.residuals import (
    LearnedResiduals,
    full_light,
    learn_residuals,
    usual_residuals,
)
from impasto.fit.result import Sbrdf
from impasto.fit.rig_refinement import refined
from impasto.fit.segments import SegmentSbrdf, fit_segments
from impasto.rig import seen_from_front
from impasto.stack import Stack

Chosen: TypeAlias = tuple[Choice | None, FitKind, dict[str, Any]]
"""How a fit was chosen, the fit and its options."""
Fitted: TypeAlias = PooledSbrdf | SegmentSbrdf | LobeSbrdf | LafortuneSbrdf
"""Every kind of result."""


def check_arguments(
    method: Method | None,
    residuals: bool | None,
    threads: int | None,
    progress: bool | ProgressCallback,
) -> None:
    """Refuse what no fit takes, before minutes of work on the rig and the choice."""
    if method is not None:
        one_of(method, METHODS, "normals")
    if residuals is not None:
        truth(residuals, "residuals")
    thread_count(threads)
    check_progress(progress)


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

    few = reduced(stack, JUDGED, threads=threads)
    return learn_residuals(stack, with_its_own, part=few.stack, truth=few.truth, threads=threads)


def _plain_fit(
    kind: FitKind,
    given: Mapping[str, Any],
    normals: Normals | Method | None,
    threads: int | None,
) -> Fit:
    """A fit to some photographs, without what is learned from those that are held out."""
    method = normals if isinstance(normals, str) else None
    own = {name: given.get(name) for name in kind.defaults}
    effort = resolved("standard")
    options = checked_options(kind, own) | {"effort": effort, "threads": threads, "progress": False}

    def fit(known: Stack) -> Fitted:
        stereo = start_normals(known, method, effort, threads, False)
        return fit_of_kind(known, kind, stereo, options)

    return fit


def fit_of_kind(
    stack: Stack,
    kind: FitKind,
    stereo: Normals,
    options: Mapping[str, Any],
    labels: Any = None,
) -> Fitted:
    """The fit itself, from the maps of photometric stereo; ``labels`` of segments."""
    own: dict[str, Any] = dict(options)

    def pooled(stereo: Normals) -> PooledSbrdf:
        return fit_pooled(stack, stereo, **own)

    if kind.model == "lafortune":
        return fit_lafortune(stack, stereo, **own)
    if kind.pooling == "none":
        return without_gloss(stack, stereo)
    if kind.pooling == "pixel":
        return fit_lobes(stack, stereo, **own)
    return pooled(stereo) if labels is None else fit_segments(labels, stereo, pooled)


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

    def fit(candidate: Candidate) -> Fit:
        options: dict[str, Any] = {**given, **candidate.options}
        tried = fit_kind(kinds[0].model, options.pop("pooling"))
        plain = _plain_fit(tried, options, method, threads)

        def around_it(known: Stack) -> Sbrdf:
            relief = around(known)
            seen = known if relief is None else relief.removed(known, threads=threads)
            result: Sbrdf = replace(plain(seen), relief=relief)
            if not kept:
                return result
            return replace(result, residuals=usual_residuals(known, result, top(known), threads))

        return around_it

    top = cache(full_light)
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
        fitted: Normals = fit_normals(stack, **options, progress=progress)
        return fitted
    checked_normals(normals, stack)
    return normals if stack.mask is None else wait_for(normals.within, stack.mask)


def checked_normals(normals: Any, stack: Stack) -> None:
    """Refuse what are no normals of this stack."""
    if isinstance(normals, PartialNormals):
        raise ArgumentError(
            f"normals: a fit needs all maps of impasto.fit_normals, found {normals!r}; call "
            "impasto.fit_normals without maps="
        )
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
