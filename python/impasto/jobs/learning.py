"""The first pass of a job: what the fit of every tile must know of the whole painting."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypedDict, get_type_hints

from impasto._internal.calls import ProgressCallback
from impasto._internal.checks import one_of, suggestion, truth
from impasto._internal.regular import content_of
from impasto.effort import Effort, EffortLike, resolved
from impasto.errors import ArgumentError
from impasto.fit.learning import LearnedModel, learn_sbrdf
from impasto.fit.lobes import HALO
from impasto.fit.normals import METHODS, Method
from impasto.fit.options import Model, Pooling, fit_kinds
from impasto.fit.pooled import Extraction
from impasto.fit.stages import checked_options
from impasto.fit.subsample import Sample
from impasto.jobs.photographs import Photographs
from impasto.jobs.record import plain

LEARNED = "learned.npz"


class FitOptions(TypedDict, total=False):
    """Options of :func:`impasto.fit_sbrdf` that a job takes: those of :func:`learn_sbrdf`."""

    model: Model
    pooling: Pooling
    lobes: int | None
    ambient: bool | None
    coated: bool | None
    extraction: Extraction | None
    peak: bool | None
    joint: bool | None
    index: float | None
    normals: Method | None
    refine: bool | None
    residuals: bool | None
    relief: bool | None
    effort: EffortLike


NAMES = tuple(get_type_hints(FitOptions))
"""Of these options."""
OWN = ("lobes", "ambient", "coated", "extraction", "peak", "joint", "index")
"""Those that only some fits have."""


def border_of(fit: Mapping[str, Any]) -> int:
    """Most pixels around a tile that a fit with these options needs: where seeds may lie."""
    own_lobes = fit["model"] == "torrance-sparrow" and fit["pooling"] in ("auto", "pixel")
    return HALO if own_lobes and fit["effort"]["start"] != "multistart" else 0


def checked_fit(given: Mapping[str, Any]) -> dict[str, Any]:
    """Every option of a fit, with its default where it is not given, as a job keeps it.

    Raises
    ------
    ArgumentError
        An unknown option, or a value that the fit refuses.
    """
    for name in given:
        if name not in NAMES:
            raise ArgumentError(
                f"{name}: a job has no such option{suggestion(name, NAMES)}; it knows "
                f"{', '.join(NAMES)}"
            )
    options: dict[str, Any] = {name: given.get(name) for name in NAMES}
    options["model"] = given.get("model", "torrance-sparrow")
    options["pooling"] = given.get("pooling", "auto")
    options["effort"] = asdict(resolved(given.get("effort", "standard")))
    if options["pooling"] == "segment":
        raise ArgumentError(
            'pooling: "segment" cannot be learned from a sample, so that no job can fit it; fit '
            'the whole by fit_sbrdf(stack, pooling="segment")'
        )
    own = {name: options[name] for name in OWN}
    for kind in fit_kinds(options["model"], options["pooling"], own):
        checked_options(kind, own)
    if options["normals"] is not None:
        one_of(options["normals"], METHODS, "normals")
    for name in ("refine", "residuals", "relief"):
        if options[name] is not None:
            truth(options[name], name)
    return {name: plain(value, name) for name, value in options.items()}


def learned_from(
    photographs: Photographs,
    fit: Mapping[str, Any],
    stride: int,
    side: int,
    *,
    threads: int | None,
    progress: bool | ProgressCallback,
    check: Callable[[], object],
) -> LearnedModel:
    """What is learned from every so many rows and columns, read in windows of ``side``.

    An error of ``check`` ends it: it is called after the photographs are read, and while models are
    fitted to them unless there is a bar.
    """
    options = dict(fit) | {"effort": Effort(**fit["effort"])}
    options |= {"threads": threads, "progress": progress is True or (lambda *_: check())}
    few = photographs.sampled(Sample(stride, photographs.size), side)
    check()
    model = learn_sbrdf(few, sample=1, **options)
    return model.magnified(stride, photographs.size)


def digest_of(path: Path) -> str:
    """SHA-256 of a small file."""
    return hashlib.sha256(content_of(path)).hexdigest()
