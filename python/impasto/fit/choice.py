"""What ``pooling="auto"`` fits: the candidate that predicts held-out photographs best.

Model selection by cross-validation [@stone1974].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.waiting import wait_for_each
from impasto.encoding import Encoding
from impasto.errors import GeometryError
from impasto.fit.cross_validation import FEWEST, Fold, folds_of, full_scale
from impasto.fit.subsample import subsampled_to
from impasto.io.results import SavedMaps
from impasto.rig import Rig
from impasto.stack import Stack

PIXELS = 1024
"""Approximate number of sampled pixels, spread over the picture, also for the process of residuals.
1024, 2048 and 4096 choose the same on 16 stacks: 9 to 72 photographs of the icon, 9 to 48 of four
simulated varnishes."""
MARGIN = 0.1
"""dB by which a candidate must predict better than a simpler one; smaller differences change from
sample to sample."""
Predicted = tuple[NDArray[np.float64], NDArray[np.float64]]
"""PSNR ``(obs,)`` of a candidate's photographs: of the model alone, and with residuals."""
ByProcess = dict[tuple[float, float], NDArray[np.float64]]
"""PSNR ``(obs,)`` of the photographs of a fold, by length and noise of the residuals' process."""
PROCESSES = ((0.3, 0.01), (0.15, 0.1), (1.2, 0.001))
"""Lengths and noises of the residuals that are compared."""
ROUNDING = 1.0 / 12.0
"""Least mean squared error of a photograph, in squared 8-bit codes: that of rounding."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One fit that was considered.

    Attributes
    ----------
    pooling
        ``"none"``, ``"painting"`` or ``"pixel"``, as in :func:`impasto.fit_sbrdf`.
    lobes, ambient
        Its options with ``pooling="pixel"``; 1 and False otherwise.
    coated
        Whether diffuse light crosses a varnish; False without gloss.
    decibels
        Peak signal-to-noise ratio of held-out photographs, coded as sRGB: the mean over the
        photographs, with what the fit leaves interpolated where that helps; NaN if it was not
        tried.
    """

    pooling: Literal["none", "painting", "pixel"]
    lobes: int = 1
    ambient: bool = False
    decibels: float = float("nan")
    coated: bool = False

    @property
    def options(self) -> dict[str, Any]:
        """What :func:`impasto.fit_sbrdf` takes."""
        if self.pooling == "none":
            return {"pooling": "none"}
        own: dict[str, Any] = {"pooling": self.pooling, "coated": self.coated}
        if self.pooling == "pixel":
            own |= {"lobes": self.lobes, "ambient": self.ambient}
        return own

    def __str__(self) -> str:
        varnish = " under a varnish" * self.coated
        if self.pooling == "none":
            return "no gloss"
        if self.pooling == "painting":
            return "one lobe for the painting" + varnish
        most = "one lobe per pixel" if self.lobes == 1 else f"up to {self.lobes} lobes per pixel"
        return most + " and ambient light" * self.ambient + varnish


UNTRIED = Candidate("painting")
"""What is fitted where nothing can be tried."""

CANDIDATES = (
    Candidate("none"),
    UNTRIED,
    Candidate("painting", coated=True),
    Candidate("pixel", 1, ambient=False),
    Candidate("pixel", 1, ambient=True),
    Candidate("pixel", 2, ambient=False),
    Candidate("pixel", 2, ambient=True),
)
"""What ``pooling="auto"`` considers, the simplest first; then :func:`under_varnish`."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What ``pooling="auto"`` chose, and against what.

    Attributes
    ----------
    best
        The fit that was chosen.
    tried
        All candidates with their errors, the simplest first.
    photographs
        How many photographs were held out and predicted; 0 if nothing was tried.
    why
        Why nothing was tried; empty otherwise.
    """

    best: Candidate
    tried: tuple[Candidate, ...]
    photographs: int
    why: str = ""

    @property
    def gain(self) -> float:
        """How much better it is than the best fit of the other pooling, in dB; NaN if not tried."""
        others = [other.decibels for other in self.tried if other.pooling != self.best.pooling]
        return self.best.decibels - max(others, default=float("nan"))

    def __str__(self) -> str:
        if not self.tried:
            return f"{self.best} ({self.why})"
        others = [other for other in self.tried if other.pooling != self.best.pooling]
        second = max(others, key=lambda other: other.decibels)
        return (
            f"{self.best}: {self.best.decibels:.1f} dB on {self.photographs} held-out photographs; "
            f"{second}: {second.decibels:.1f} dB"
        )

    def report(self) -> dict[str, Any]:
        """Plain numbers for a report file."""
        return {
            "chosen": self.best.options,
            "held_out_photographs": self.photographs,
            "tried": [{**one.options, "decibels": one.decibels} for one in self.tried],
            "why": self.why,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The choice among the arrays of a result file."""
        rows = (self.best, *self.tried)
        return {
            "chosen.pooling": np.array([row.pooling for row in rows], dtype=np.str_),
            "chosen.lobes": np.array([row.lobes for row in rows], dtype=np.int64),
            "chosen.ambient": np.array([row.ambient for row in rows], dtype=np.bool_),
            "chosen.coated": np.array([row.coated for row in rows], dtype=np.bool_),
            "chosen.decibels": np.array([row.decibels for row in rows], dtype=np.float64),
            "chosen.photographs": np.array(self.photographs, dtype=np.int64),
            "chosen.why": np.array(self.why, dtype=np.str_),
        }

    @classmethod
    def of_maps(cls, maps: SavedMaps) -> Choice | None:
        """The inverse of :meth:`arrays`; None if the file has no choice."""
        if "chosen.pooling" not in maps.arrays:
            return None
        pooling = maps.array("chosen.pooling", np.str_, (None,))
        known = set(pooling.tolist()) <= {"none", "painting", "pixel"} and len(pooling) > 0
        maps.demand(
            "chosen.pooling", known, 'holds something else than "none", "painting" and "pixel"'
        )
        columns = [
            maps.array(f"chosen.{name}", dtype, pooling.shape).tolist()
            for name, dtype in (
                ("lobes", np.int64),
                ("ambient", np.bool_),
                ("decibels", np.float64),
                ("coated", np.bool_),
            )
        ]
        best, *tried = (Candidate(*row) for row in zip(pooling.tolist(), *columns, strict=True))
        return cls(
            best,
            tuple(tried),
            int(maps.array("chosen.photographs", np.int64, ())),
            str(maps.array("chosen.why", np.str_, ())),
        )


def choose(
    stack: Stack,
    candidates: Sequence[Candidate],
    fit: Callable[[Candidate], Callable[[Stack], Any]],
    *,
    open_varnish: bool = True,
    part: Stack | None = None,
    truth: Stack | None = None,
    threads: int | None,
    progress: bool | ProgressCallback,
) -> Choice:
    """The simplest candidate about as good as any other.

    About as good: its mean over the photographs is worse by less than :data:`MARGIN`, or would be
    without the photograph where it loses most, because lamps that are wrong by themselves tell fits
    apart by chance. First with residuals, which are kept where they help; then, among those that
    are about as good, of the model alone: what is interpolated hides wrong normals.

    Parameters
    ----------
    stack
        The photographs.
    candidates
        Of :data:`CANDIDATES`, in their order.
    fit
        Of a candidate: what fits it to some photographs and returns a result that can ``predict``
        others, with its residuals if they may be kept.
    open_varnish
        Whether the best of lobes per pixel is tried under a varnish, too.
    part
        The pixels to judge by; default: a sample of some 1000 of the stack's.
    truth
        What is compared with predictions of ``part``; default: ``part``.
    threads
        As in :func:`impasto.fit_sbrdf`.
    progress
        True: a bar; a callable is left to the fit that follows.
    """
    count = len(stack.rig)
    if count < FEWEST:
        return Choice(UNTRIED, (), 0, f"{count} photographs are too few to hold any out")
    try:
        part = subsampled_to(stack, PIXELS) if part is None else part
        folds = folds_of(part, threads, truth=truth)
    except GeometryError:
        return Choice(UNTRIED, (), 0, "without some of the photographs no normal is determined")
    if all(fold.unknown is not None for fold in folds):
        return Choice(UNTRIED, (), 0, "no sampled pixel can be estimated")
    if all(np.isnan(fold.compared).all() for fold in folds):
        return Choice(UNTRIED, (), 0, "no held-out photograph shows a pixel that can be estimated")
    top = full_scale(one for fold in folds for one in fold.compared)
    tried: list[Candidate] = []
    each: list[Predicted] = []

    done = 0
    with reporting(progress is True, "choice") as callback:

        def tick() -> None:
            nonlocal done
            done += 1
            if callback is not None:
                callback(done, max(done, len(candidates) * len(folds)))

        def judge(some: Sequence[Candidate]) -> None:
            def judged(pair: tuple[Candidate, Fold]) -> ByProcess:
                return predicted_in(fit(pair[0]), pair[1], top, threads)

            pairs = [(one, fold) for one in some for fold in folds]
            found = wait_for_each(judged, pairs, thread_count(threads), tick)
            for index, one in enumerate(some):
                ways = joined(found[index * len(folds) : (index + 1) * len(folds)])
                # The model alone, and with the residuals that help most, if any do.
                each.append((ways[0], max(ways, key=np.mean)))
                tried.append(replace(one, decibels=float(each[-1][1].mean())))

        judge(candidates)
        judge(under_varnish(tried, each) if open_varnish else [])
    return Choice(simplest(tried, each), tuple(tried), sum(len(fold.rig) for fold in folds))


def predicted(
    fit: Callable[[Stack], Any], folds: Sequence[Fold], top: float, threads: int | None
) -> list[NDArray[np.float64]]:
    """PSNR ``(obs,)`` of all photographs held out, by the model alone and by each process.

    Parameters
    ----------
    fit
        Fits the photographs of a fold; its result can ``predict`` those that are held out.
    folds
        The folds.
    top
        Linear light of full scale.
    threads
        None means every allowed core.
    """

    def of(fold: Fold) -> ByProcess:
        return predicted_in(fit, fold, top, threads)

    return joined(wait_for_each(of, folds, thread_count(threads)))


def predicted_in(
    fit: Callable[[Stack], Any], fold: Fold, top: float, threads: int | None
) -> ByProcess:
    """The same of the photographs of one fold."""
    shown = shown_by_process(fit(fold.known), fold.rig, threads)
    return {process: decibels(one, fold.compared, top) for process, one in shown.items()}


def joined(each: Sequence[ByProcess]) -> list[NDArray[np.float64]]:
    """The PSNR of all folds, by process."""
    ways: dict[tuple[float, float], list[NDArray[np.float64]]] = {}
    for found in each:
        for process, one in found.items():
            ways.setdefault(process, []).append(one)
    return [np.concatenate(way) for way in ways.values()]


def under_varnish(tried: Sequence[Candidate], each: Sequence[Predicted]) -> list[Candidate]:
    """Lobes per pixel, as many as are best without, now with a coated diffuse part.

    Both with and without ambient light, if both were tried: a varnish changes what is best.
    """
    pixel = [index for index, one in enumerate(tried) if one.pooling == "pixel"]
    if not pixel:
        return []
    best = simplest([tried[index] for index in pixel], [each[index] for index in pixel])
    return [
        replace(tried[index], coated=True, decibels=float("nan"))
        for index in pixel
        if tried[index].lobes == best.lobes
    ]


def shown_by_process(
    result: Any, rig: Rig, threads: int | None
) -> dict[tuple[float, float], NDArray[np.float32]]:
    """What a fit predicts: the model alone (zeros), and with residuals by their process."""
    model = result.predict(rig, fidelity="model", threads=threads)
    found = {(0.0, 0.0): model}
    if result.residuals is not None:
        for process in PROCESSES:
            length, noise = process
            found[process] = model.copy()
            residuals = replace(result.residuals, length=length, noise=noise)
            result.add_residuals(found[process], residuals, rig)
    return found


def decibels(shown: NDArray[Any], truth: NDArray[Any], top: float = 1.0) -> NDArray[np.float64]:
    """Peak signal-to-noise ratio of each photograph, both coded as sRGB.

    Parameters
    ----------
    shown, truth
        ``(obs, band, y, x)`` linear light. A prediction that is NaN counts as black, a clipped
        sample (+inf) as white; a sample of the truth that is NaN does not count.
    top
        Linear light of full scale.

    Returns
    -------
    ndarray
        ``(obs,)``; of the photographs that have a sample.
    """
    curve = Encoding("srgb", white=255.0)
    with np.errstate(over="ignore"):  # samples near the largest float32: white
        shown, truth = shown / top, truth / top
    shown = curve.encode(np.nan_to_num(shown, nan=0.0))
    real = curve.encode(np.nan_to_num(truth, nan=0.0, posinf=1.0))
    return psnr(shown, np.where(np.isnan(truth), np.nan, real))


def psnr(shown: NDArray[Any], truth: NDArray[Any]) -> NDArray[np.float64]:
    """The same of 8-bit codes, which need not be whole numbers."""
    count = len(truth)
    difference = np.subtract(shown, truth, dtype=np.float64).reshape(count, -1)
    samples = np.isfinite(difference).sum(axis=1)
    mean = np.nansum(difference**2, axis=1)[samples > 0] / samples[samples > 0]
    return np.asarray(10.0 * np.log10(255.0**2 / np.maximum(mean, ROUNDING)))


def simplest(tried: Sequence[Candidate], each: Sequence[Predicted]) -> Candidate:
    """The simplest candidate about as good as any other, as :func:`choose` says."""
    good = np.ones(len(tried), np.bool_)
    for way in (1, 0):
        photographs = np.array([one[way] for one in each])
        # Not only as the best in the mean, which may be that by one photograph.
        good &= np.all([_about_as_good(photographs, one) for one in photographs[good]], axis=0)
    return tried[int(np.argmax(good))]


def _about_as_good(
    photographs: NDArray[np.float64], rival: NDArray[np.float64]
) -> NDArray[np.bool_]:
    lost = rival - photographs
    count = lost.shape[1]
    if count == 1:
        return np.asarray(lost[:, 0] <= MARGIN)
    without = (lost.sum(axis=1) - lost.max(axis=1)) / (count - 1)
    return np.asarray((lost.mean(axis=1) <= MARGIN) | (without <= MARGIN))
