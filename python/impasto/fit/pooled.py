"""One lobe for a whole painting, fitted together with all its normals and colours."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NotRequired, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import StackArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import refractive_index
from impasto._internal.wording import percent
from impasto.effort import Effort
from impasto.fit.gloss import Gloss, fitted_gloss
from impasto.fit.learned import LearnedLobe, PooledMaps
from impasto.fit.normals import Normals
from impasto.fit.result import Sbrdf, shared_fields
from impasto.fit.saved import over
from impasto.fit.start import StartArguments
from impasto.io.results import SavedMaps
from impasto.stack import Stack
from impasto.status import Status
from impasto.surface import Surface

Extraction = Literal["residual", "maximum", "papers", "printed"]

VERDICTS = ("fitted", "mixed", "no-highlight", "at-bound", "too-few")


_GAMMA, _INDEX = 1.0, 1.45
"""Width (rad) and index of refraction of a lobe of strength 0: any will do."""

_WITHOUT = {"no-highlight": "no highlight", "too-few": "no pixel that could show a highlight"}
"""Verdicts without a lobe, in words."""


@dataclass(frozen=True, eq=False, repr=False)
class PooledSbrdf(Sbrdf):
    """A painting with one lobe for all pixels. :class:`Sbrdf` has the members of all results.

    ``residual`` and ``sigma`` of an :attr:`~impasto.Status.EXACT` pixel are NaN where its samples
    (three lights in one band) do not outnumber its unknowns. ``sigma`` is computed for a known
    lobe, with the colours eliminated. ``status`` is that of the normals, and ``POOLED`` where the
    samples of the pixel do not support the lobe: ``normal`` and ``diffuse`` are then those of
    ``normals``.

    Attributes
    ----------
    beta, gamma
        The painting's lobe (six-band paper eq. 1, RGB paper eq. 9): strength relative to the white
        board, half-width of the facets in radians. ``beta`` is 0 where no highlight was found.
    index
        Index of refraction of the interface.
    covariance
        ``(2, 2)`` of (log beta, log gamma), from the scatter of the pixels' gradients; infinite
        where there is no highlight. It is the error of the lobe that fits all pixels best, not the
        difference of a pixel's own lobe from it (``misfit``).
    verdict
        ``"fitted"``; ``"mixed"``: there is a lobe, but ``describes`` is below 0.8, as with several
        varnishes or gilding; ``"no-highlight"``: no lobe above the noise, ``beta`` is 0;
        ``"at-bound"``: the width ended at a bound, as sharp as a mirror or as flat as paper;
        ``"too-few"``: no pixel that could show a highlight was estimated.
    curve
        ``(n, 3)`` the measured lobe: phi (rad), specular part over its geometry factor, samples.
        With ``joint=False`` these are the samples that the lobe was fitted to, divided as for the
        fit; else all samples that are not in shadow, beside the fitted normals and colours.
    path
        ``(n, 2)`` beta and gamma of each improvement, starting with the separate fit of the papers.
    describes
        Of the pixels that determine their own strength to 20 %, the share whose strength agrees
        with that of the painting to 25 % or three standard deviations; NaN if no pixel does.
    converged
        Whether the search for the lobe ended by its convergence tests, not by its last step.
    misfit
        ``(y, x)`` float32, 0 to 1: difference between the pixel's own strength and ``beta`` beyond
        three standard deviations, as a share of ``beta``; 0 where the photographs do not determine
        it; NaN, like residual and sigma, where there are as many samples as unknowns (``EXACT``).
    coated
        Whether diffuse light crosses that interface (:class:`Surface`); False where normals and
        colours are those of photometric stereo.
    """

    beta: float = field(metadata=over(dtype=np.float64))
    gamma: float = field(metadata=over(dtype=np.float64))
    index: float = field(metadata=over(dtype=np.float64))
    covariance: NDArray[np.float64] = field(metadata=over("row", "column", dtype=np.float64))
    verdict: str = field(metadata=over(dtype=np.str_))
    curve: NDArray[np.float64] = field(metadata=over("tilt", "measured", dtype=np.float64))
    path: NDArray[np.float64] = field(metadata=over("step", "parameter", dtype=np.float64))
    describes: float = field(metadata=over(dtype=np.float64))
    converged: bool = field(metadata=over(dtype=np.bool_))
    misfit: NDArray[np.float32] = field(metadata=over("y", "x"))
    coated: bool = field(default=False, metadata=over(dtype=np.bool_))

    def surface(self) -> Surface:
        """The painting with its one lobe, for rendering."""
        return Surface.torrance_sparrow(
            self.normal,
            self.diffuse,
            self.beta,
            self.gamma,
            index=self.index,
            coated=self.coated,
            **self._place(),
        )

    @cached_property
    def gloss(self) -> Gloss:
        """The fitted (beta, gamma) with the standard deviations of its covariance."""
        return fitted_gloss(self.beta, self.gamma, self.covariance, self.describes)

    def _shape_sigma(self, lobe: int, y: int, x: int) -> float:
        return math.sqrt(self.covariance[1, 1])

    def report(self) -> dict[str, Any]:
        """Numbers of the gloss for a report file."""
        return {
            "beta": self.beta,
            "gamma_degrees": math.degrees(self.gamma),
            "index": self.index,
            "coated": self.coated,
            "verdict": self.verdict,
            "describes": self.describes,
            "converged": self.converged,
            "covariance_log_beta_log_gamma": self.covariance,
        }

    def _demand(self, maps: SavedMaps, prefix: str = "") -> None:
        def demand(name: str, holds: bool, problem: str) -> None:
            maps.demand(prefix + name, holds, problem)

        known = ", ".join(VERDICTS)
        demand("verdict", self.verdict in VERDICTS, f"is {self.verdict!r}, none of {known}")
        beta, gamma = self.beta, self.gamma
        demand("beta", 0.0 <= beta < np.inf, f"is {beta:g}, not a finite strength from 0 on")
        demand("gamma", 0.0 < gamma <= 2.0, f"is {gamma:g} rad, not within 0 to 2")
        variances = np.diag(self.covariance)
        demand(
            "covariance", bool((variances >= 0.0).all()), "holds variances that are not from 0 on"
        )
        refractive_index(self.index)

    def _gloss(self) -> str:
        if self.verdict in _WITHOUT:
            lobe = _WITHOUT[self.verdict]
        else:
            spread = [math.sqrt(self.covariance[i, i]) for i in range(2)]
            lobe = (
                f"beta {self.beta:.4g} ± {percent(spread[0])}, "
                f"gamma {self.gamma:.4g} rad ± {percent(spread[1])}"
            )
            if self.verdict == "mixed":
                lobe += (
                    f", but only {100 * self.describes:.0f} % of the pixels agree with it "
                    '(pooling="pixel" gives each its own)'
                )
            elif self.verdict != "fitted":
                lobe += f" ({self.verdict})"
        lobe += " under a varnish" * self.coated
        over = self.converged or self.verdict == "no-highlight"
        return lobe if over else f"{lobe}; {self._under_way()}"

    def _under_way(self) -> str:
        """How much the last step changed the lobe, compared with its standard deviations."""
        words = "the search was still under way at its last step"
        if len(self.path) < 2 or not (self.path[-2:] > 0.0).all():
            return words
        change = np.expm1(np.abs(np.diff(np.log(self.path[-2:]), axis=0)[0]))
        known = bool((change < np.sqrt(np.diag(self.covariance))).all())
        advice = "less than their ±: harmless" if known else 'see describes, or pooling="pixel"'
        return (
            f"{words}, which changed beta by {100 * change[0]:.1g} % and gamma by "
            f"{100 * change[1]:.1g} % ({advice})"
        )


class PooledOptions(TypedDict):
    """Options of a pooled fit, as in :func:`impasto.fit_sbrdf`."""

    extraction: Extraction
    peak: bool
    joint: bool
    coated: NotRequired[bool]
    index: float
    effort: Effort
    threads: int | None
    progress: bool | ProgressCallback


def without_gloss(stack: Stack, stereo: Normals) -> PooledSbrdf:
    """A matte painting: the normals and albedo of photometric stereo, and no lobe."""
    known = stereo.status < Status.DARK
    names = ("normal", "residual", "sigma", "status")
    maps = {"diffuse": stereo.albedo, **{name: getattr(stereo, name) for name in names}}
    return PooledSbrdf(
        **shared_fields(maps, stack, stereo),
        beta=0.0,
        gamma=_GAMMA,
        index=_INDEX,
        covariance=np.diag([np.inf, np.inf]),
        verdict="no-highlight" if known.any() else "too-few",
        curve=np.zeros((0, 3)),
        path=np.zeros((0, 2)),
        describes=math.nan,
        converged=True,
        misfit=np.where(known, np.float32(0.0), np.float32(np.nan)),
    )


def fit_pooled(stack: Stack, stereo: Normals, **options: Unpack[PooledOptions]) -> PooledSbrdf:
    """One lobe, from the maps of photometric stereo; see :func:`impasto.fit_sbrdf`.

    The result is that of :func:`learn_pooled` and :func:`apply_pooled` of the same stack, in less
    time: every pixel is visited once for both.
    """
    maps = PooledMaps.empty(len(stack.bands), stereo.status.shape)
    learned = learn_pooled(stack, stereo, maps=maps, **options)
    return pooled_sbrdf(learned, maps, stack, stereo)


def learn_pooled(
    stack: Stack,
    stereo: Normals,
    *,
    maps: PooledMaps | None = None,
    **options: Unpack[PooledOptions],
) -> LearnedLobe:
    """The lobe of a painting, from all its pixels or a sample of them.

    Parameters
    ----------
    stack
        Photographs of the painting or of a part of it.
    stereo
        Photometric stereo of the same pixels. Pixels without a normal do not count and take no
        time: a sample of a painting is a ``status`` that is ``NOT_COMPUTED`` elsewhere.
    maps
        Arrays to fill with the result of :func:`apply_pooled` for the same stack; default: none.
    **options
        See :class:`PooledOptions`.
    """
    with reporting(options["progress"], "gloss") as callback:
        found = _core.learn_pooled(
            StackArguments.of(stack),
            StartArguments.of(stereo),
            maps,
            options["extraction"],
            options["peak"],
            options["joint"],
            options.get("coated", False),
            options["index"],
            options["effort"].pixels,
            thread_count(options["threads"]),
            callback,
        )
    return LearnedLobe(
        beta=found["beta"],
        gamma=found["gamma"],
        log_sharpness=found["log_sharpness"],
        index=found["index"],
        refined=found["refined"],
        coated=found["coated"],
        brightness=found["brightness"],
        noise=np.array(found["noise"], dtype=np.float32),
        noise_floor=found["noise_floor"],
        covariance=np.array(found["covariance"], dtype=np.float64),
        verdict=found["verdict"] if stereo.status.min() < Status.DARK else "too-few",
        describes=found["describes"],
        converged=found["converged"],
        curve=np.array(found["curve"], dtype=np.float64).reshape(-1, 3),
        path=np.array(found["path"], dtype=np.float64).reshape(-1, 2),
    )


def apply_pooled(
    learned: LearnedLobe,
    stack: Stack,
    stereo: Normals,
    *,
    maps: PooledMaps | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> PooledMaps:
    """Normals and colours of a tile under a learned lobe, with their errors.

    A pixel's result depends on its own samples, its place in the painting (``stack.rig.origin``)
    and ``learned`` only: the maps of a tile are those of the whole, bit for bit.

    Parameters
    ----------
    learned
        The result of :func:`learn_pooled`.
    stack, stereo
        Photographs of the tile and their photometric stereo.
    maps
        Arrays to fill, of the tile's size; default: new ones.
    threads
        Number of threads; None means every allowed core.
    progress
        True for a bar on stderr, or a callable ``(done, total)``.

    Raises
    ------
    ArgumentError
        Maps of another size.
    """
    if maps is None:
        maps = PooledMaps.empty(len(stack.bands), stereo.status.shape)
    with reporting(progress, "gloss") as callback:
        _core.apply_pooled(
            learned,
            StackArguments.of(stack),
            StartArguments.of(stereo),
            maps,
            thread_count(threads),
            callback,
        )
    return maps


def pooled_sbrdf(
    learned: LearnedLobe, maps: PooledMaps, stack: Stack, stereo: Normals
) -> PooledSbrdf:
    """The public result, from a learned lobe and the maps of its application."""
    return PooledSbrdf(
        **shared_fields(vars(maps), stack, stereo),
        beta=learned.beta,
        gamma=learned.gamma,
        index=learned.index,
        covariance=learned.covariance,
        verdict=learned.verdict,
        curve=learned.curve,
        path=learned.path,
        describes=learned.describes,
        converged=learned.converged,
        misfit=maps.misfit,
        coated=learned.coated,
    )
