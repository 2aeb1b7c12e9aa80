"""Semi-calibrated photometric stereo [@cho2020semicalibrated]: lamps of unknown strength."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole, refractive_index
from impasto.errors import ArgumentError
from impasto.fit.lobes import fit_lobes, lobe_count
from impasto.fit.normals import fit_normals
from impasto.rig import Light, Rig
from impasto.stack import Stack, checked_stack
from impasto.status import Status
from impasto.surface import Surface
from impasto.thinning import thinned_to

UNKNOWNS = 6
"""Of a pixel: normal (2), brightness, ambient light, and one lobe's strength and width. A lamp's
factor is asked of the mean of the bands, so that more bands tell no more of it."""
FEWEST = UNKNOWNS + 1
"""Lights below which strengths and surfaces cannot be told apart."""

_PIXELS = 10_000
_ROUNDS = 12
_STILL = 0.005
_SETTLED, _FEW = 0.01, 0.1
"""A few lamps that still move by more than one per cent do no harm: going on for twelve rounds more
on the icon, where they are 4 of 72, turns the normals by less than 0.1 degrees (median)."""
_STRETCH = 1.5
"""A surface follows wrong strengths part of the way, so that every round finds only a part of what
is left; a step longer than that by less than 2 cannot diverge where the parts are 0 to 1."""
_MEMORY = 3
"""Rounds that the next step is foretold from: as many slow modes are gone through at once."""
_RIDGE = 1e-3
"""Share of the rounds' mean square below which a difference between them is their wavering."""
_MATTE_ROUNDS = 6
_GROSS = np.log(2.0)
"""A lamp that is off by more than this factor hides all others from a fit of lobes."""
_CLEAR = 0.1
"""A shorter step than this does not change which lamps are."""
_NAMED = 8
"""Photographs that words name by their numbers."""
_DIM = 0.2
"""Share of a pixel's mean light below which shadows tell more than the lamp."""


@dataclass(frozen=True, eq=False, repr=False)
class Strengths:
    """Strengths of the lamps of a stack.

    Attributes
    ----------
    factor
        ``(obs,)`` float64: what each light gave relative to its ``intensity``; their median is 1.
        NaN where no pixel tells: the photograph is black or missing wherever its lamp should show.
    rig
        The lights with these strengths as intensities; the intensity of a lamp that no pixel tells
        is the one that was given.
    stack
        The photographs under these lights: what to fit.
    converged
        Whether no factor was to go further than 0.5 %, as foretold from the last rounds. What is
        left then is mostly what the model lacks, and more of it the fewer lamps there are: on
        simulated paintings the worst of log-normal lamps (0.3) was off by 1 to 10 % of 24, by 5 to
        23 % of twelve, by 12 to 45 % of seven to nine; of even lamps by 0.5 to 2 %. Where it is
        False, see ``change``: a few lamps that have not settled do little harm; where they are more
        than a tenth, ask for more ``rounds``, or call :func:`fit_strengths` again with ``stack``,
        which goes on from there.
    change
        ``(obs,)`` by what share the last round, which foretells where they end, changed each
        factor: 0.01 is one per cent. NaN where no pixel tells.
    """

    factor: NDArray[np.float64]
    rig: Rig
    stack: Stack
    converged: bool
    change: NDArray[np.float64]

    def at(self, lights: ArrayLike | Sequence[Light] | Rig) -> Rig:
        """Other lights with the strengths that lamps in their directions gave.

        The logarithms of the factors are interpolated by a thin plate over the directions' x and y
        and stay within what was found. That foretells a lamp whose strength goes with its place (an
        arm of a dome, a distance that was not kept), not one that flickers.

        Parameters
        ----------
        lights
            ``(obs, 3)`` directions, a sequence of lights, or a :class:`~impasto.Rig`.

        Returns
        -------
        Rig
            The same lights, their intensities times the interpolated factors.
        """
        rig = Rig(lights)
        told = np.isfinite(self.factor)
        log = np.log(self.factor[told])
        found = _thin_plate(self.rig.directions[told, :2], log, rig.directions[:, :2])
        return _scaled(rig, np.exp(np.clip(found, log.min(), log.max())))

    def __repr__(self) -> str:
        low, high = np.nanmin(self.factor), np.nanmax(self.factor)
        return f"<Strengths of {len(self.rig)} lights, {low:.2f} to {high:.2f}{self.state}>"

    @property
    def state(self) -> str:
        """What is in doubt, in words: which no pixel tells, and how far the others still changed.

        Empty if all are told and converged.
        """
        return self._changing + self._untold

    @property
    def _untold(self) -> str:
        these = np.flatnonzero(np.isnan(self.factor))
        if len(these) == 0:
            return ""
        numbers = ", ".join(map(str, these[:_NAMED])) + (", ..." if len(these) > _NAMED else "")
        return (
            f", {len(these)} of which no pixel tells (photographs {numbers}: black or missing "
            "where their lamps should show): leave them out"
        )

    @property
    def _changing(self) -> str:
        if self.converged:
            return ""
        size = np.abs(self.change[np.isfinite(self.change)])
        many = int((size > _SETTLED).sum())
        most = f"{100 * size.max():.1f} %"
        if many == 0:
            return f", which the last round still changed by up to {most}: they have settled"
        few = many <= _FEW * len(size)
        return (
            f", {many} of which the last round still changed by more than {100 * _SETTLED:g} % "
            f"(up to {most}): "
            + ("the others have settled" if few else "fit_strengths(lamps.stack) goes on from here")
        )


def fit_strengths(
    stack: Stack,
    *,
    lobes: int = 2,
    index: float = 1.45,
    rounds: int = _ROUNDS,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Strengths:
    """Estimate how much light each photograph got, where nothing was measured.

    Lamps of a dome differ, a lamp held by hand comes nearer and goes farther, exposures are set
    anew: what all pixels of a photograph have in common against what the surface should show is
    the strength of its light. In turn the surface is fitted under the lamps (lobes of every pixel's
    own, :func:`fit_sbrdf` with ``pooling="pixel"``) and each lamp's factor becomes the median, over
    the pixels that it lights without clipping, of sample over expected sample. About 10,000 pixels
    spread over the painting are used. What remains of such a round shrinks slowly where the surface
    follows the lamps (tilts for strengths that grow to one side), so that each step is foretold
    from the last ones (Anderson's mixing), and the search ends where the foretold step is short.
    Lamps off by more than a factor of two are found first, by a matte surface.

    Photographs of a white board say the same directly (``white=`` of
    :func:`~impasto.read_stack`), and better: whatever a model of the surface lacks under a light
    goes into its factor, and on a painting without relief strengths that grow to one side are
    taken for a tilt.

    Parameters
    ----------
    stack
        At least 7 photographs, better 24: see ``converged``.
    lobes, index
        As for :func:`fit_sbrdf`.
    rounds
        Rounds at most, from 1 on; one takes about as long as the fit of 10,000 pixels.
    threads
        None means every allowed core; the result does not depend on it.
    progress
        True for a bar on stderr, or a callable ``(done, total)``.

    Returns
    -------
    Strengths
        Fit its ``stack``.

    Raises
    ------
    ArgumentError
        Fewer lights, or fewer that pixels tell; or so few pixels that can be fitted that they have
        as many unknowns, with one lobe each, as samples: fewer than seven under seven lights, than
        two under twelve or more.

    Notes
    -----
    Semi-calibrated photometric stereo (Cho, Matsushita, Tai and Kweon, CVPR 2016) by alternation,
    with highlights in the model and medians for sums; accelerated as by Anderson (JACM 12, 1965).
    """
    checked_stack(stack)
    lobes, index = lobe_count(lobes), refractive_index(index)
    if not (is_whole(rounds) and rounds >= 1):
        raise ArgumentError(f"rounds: expected a number from 1 on, found {rounds!r}")
    count = len(stack.rig)
    if count < FEWEST:
        raise ArgumentError(
            f"stack: strengths need at least {FEWEST} lights, found {count}; "
            "photograph a white board under each light (white=)"
        )
    few = thinned_to(stack, _PIXELS)
    samples = np.array([few.linear(photograph) for photograph in range(count)]).mean(axis=1)

    def matte(lit: Stack) -> tuple[Any, Any]:
        found = fit_normals(lit, threads=threads)
        surface = Surface(found.normal, found.albedo, index=index, origin=lit.rig.origin)
        return found.status, surface.predict(lit.rig, threads=threads)

    def glossy(lit: Stack) -> tuple[Any, Any]:
        found = fit_lobes(
            lit,
            fit_normals(lit, threads=threads),
            lobes=lobes,
            ambient=True,
            index=index,
            threads=threads,
            progress=False,
        )
        return found.status, found.predict(threads=threads)

    def told(fit: Callable[[Stack], tuple[Any, Any]], log: NDArray[np.float64]) -> Any:
        """What a surface that is fitted under some strengths leaves to each of them."""
        lit = few._replace(rig=_scaled(few.rig, np.exp(log)))
        status, expected = fit(lit)
        fine = status < Status.DARK
        _check_enough(int(fine.sum()), count)
        left = _ratios(samples[:, fine], expected.mean(axis=1)[:, fine], lit.rig.intensities)
        lamps = int(np.isfinite(left).sum())
        if lamps < FEWEST:
            raise ArgumentError(
                f"stack: strengths need at least {FEWEST} lights that pixels tell, found {lamps}"
            )
        _check_enough(int(fine.sum()), lamps)
        return left - np.nanmedian(left)

    search = _Search(np.zeros(count), stretch=1.0)
    for _ in range(_MATTE_ROUNDS):
        if np.abs(search.move(told(matte, search.log))).max() < _CLEAR:
            break
    gross = np.abs(search.log) > _GROSS
    search = _Search(np.where(gross, search.log, 0.0), stretch=_STRETCH)
    step, converged = np.zeros(count), False
    with reporting(progress, "strengths") as tell:
        for done in range(rounds):
            if tell is not None:
                tell(done, rounds)
            step = search.move(told(glossy, search.log))
            converged = bool(np.abs(step).max() < _STILL)
            if converged:
                break
        if tell is not None:
            tell(rounds, rounds)
    factor: NDArray[np.float64] = np.where(search.told, np.exp(search.log), np.nan)
    factor /= np.nanmedian(factor)
    rig = _scaled(stack.rig, np.where(search.told, factor, 1.0))
    return Strengths(
        factor=factor,
        rig=rig,
        stack=stack._replace(rig=rig),
        converged=converged,
        change=np.where(search.told, np.expm1(step), np.nan),
    )


class _Search:
    """Logarithms of strengths on their way to where a round leaves nothing to them.

    Anderson's mixing (D. G. Anderson, Journal of the ACM 12, 1965): the step that the last rounds
    foretell if what they left changed linearly with the strengths.
    """

    def __init__(self, log: NDArray[np.float64], stretch: float) -> None:
        self.log = log - np.median(log)
        self.told = np.ones(len(log), dtype=np.bool_)
        self._stretch = stretch
        self._rounds: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []

    def move(self, left: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take the step that what a round ``left`` asks for; it is returned.

        NaN asks for none: the round was not ``told``.
        """
        self.told = np.isfinite(left)
        left = np.where(self.told, left, 0.0)
        self._rounds = [*self._rounds[-_MEMORY:], (self.log, left)]
        step = self._stretch * left
        if len(self._rounds) > 1:
            ways, changes = (np.diff(each, axis=0).T for each in zip(*self._rounds, strict=True))
            # Medians of pixels waver: what two rounds in one direction tell weighs no more.
            normal = changes.T @ changes
            normal += _RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal))
            mixed = np.linalg.lstsq(normal, changes.T @ left, rcond=None)[0]
            step = step - (ways + self._stretch * changes) @ mixed
        before, self.log = self.log, self.log + step
        self.log -= np.median(self.log)
        return self.log - before


def _check_enough(pixels: int, lights: int) -> None:
    """Refuse so few pixels that strengths would be fitted to as many samples.

    Under so many lights a pixel spares what tells strengths, which are known but for one factor:
    pixels * lights samples are more than pixels * UNKNOWNS + lights - 1 unknowns.
    """
    enough = math.ceil(lights / (lights - UNKNOWNS))
    if pixels < enough:
        raise ArgumentError(
            f"stack: strengths of {lights} lights need at least {enough} pixels that can be "
            f"fitted, found {pixels or 'none'}"
        )


def _ratios(
    samples: NDArray[Any], expected: NDArray[Any], intensities: NDArray[np.float64]
) -> NDArray[np.float64]:
    """``(obs,)`` logarithms of the lamps' factors; NaN where no pixel tells."""
    even = expected / intensities[:, None]
    dim = _DIM * even.mean(axis=0)
    log = np.full(len(samples), np.nan)
    for photograph, (sample, one) in enumerate(zip(samples, expected, strict=True)):
        told = np.isfinite(sample) & (sample > 0.0) & (even[photograph] > dim)
        if told.any():
            log[photograph] = float(np.median(np.log(sample[told] / one[told])))
    return log


def _scaled(rig: Rig, factor: NDArray[np.float64]) -> Rig:
    """The rig with intensities times ``factor``."""
    lights = [
        replace(light, intensity=light.intensity * float(by))
        for light, by in zip(rig.lights, factor, strict=True)
    ]
    return rig.with_lights(lights)


def _thin_plate(
    places: NDArray[np.float64], values: NDArray[np.float64], others: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Values at other places of the plane: ``sum w r^2 log r`` plus a linear function."""

    def bend(of: NDArray[np.float64]) -> NDArray[np.float64]:
        square = ((of[:, None] - places) ** 2).sum(axis=2)
        return np.asarray(0.5 * square * np.log(np.where(square > 0.0, square, 1.0)))

    def plane(of: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([np.ones(len(of)), of])

    corner = np.zeros((3, 3))
    system = np.block([[bend(places), plane(places)], [plane(places).T, corner]])
    # Least squares: two lights in one direction have the mean of their strengths.
    weights = np.linalg.lstsq(system, np.concatenate([values, np.zeros(3)]), rcond=None)[0]
    return np.asarray(np.hstack([bend(others), plane(others)]) @ weights)
