"""What every lamp gave, from the photographs themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.checks import refractive_index
from impasto.errors import ArgumentError
from impasto.fit.border import ProgressCallback, checked_stack, reporting
from impasto.fit.lobes import fit_lobes, lobe_count
from impasto.fit.normals import fit_normals
from impasto.rig import Light, Rig
from impasto.stack import Stack
from impasto.status import Status
from impasto.thinning import thinned_to

FEWEST = 6
"""Lights below which strengths and normals cannot be told apart."""

_PIXELS = 10_000
_ROUNDS = 12
_STILL = 0.005
_SETTLED, _FEW = 0.01, 0.1
"""A few lamps that still move by more than one per cent do no harm: going on for twelve rounds more
on the icon, where they are 4 of 72, turns the normals by less than 0.1 degrees (median)."""
_STRETCH = 1.5
"""A surface follows wrong strengths part of the way, so that every round finds only a part of what
is left; a step longer than that by less than 2 cannot diverge where the parts are 0 to 1."""
_DIM = 0.2
"""Share of a pixel's mean light below which shadows tell more than the lamp."""


@dataclass(frozen=True, eq=False, repr=False)
class Strengths:
    """Strengths of the lamps of a stack.

    Attributes
    ----------
    factor
        ``(obs,)`` float64: what each light gave relative to its ``intensity``; their median is 1.
    rig
        The lights with these strengths as intensities.
    stack
        The photographs under these lights: what to fit.
    converged
        Whether the last round changed no factor by more than 0.5 %. Where it did, see ``change``:
        a few lamps that have not settled do little harm; where they are more than a tenth, call
        :func:`fit_strengths` again with ``stack``, which goes on from there.
    change
        ``(obs,)`` by what share the last round changed each factor: 0.01 is one per cent.
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
        log = np.log(self.factor)
        found = _thin_plate(self.rig.directions[:, :2], log, rig.directions[:, :2])
        return _scaled(rig, np.exp(np.clip(found, log.min(), log.max())))

    def __repr__(self) -> str:
        low, high = self.factor.min(), self.factor.max()
        return f"<Strengths of {len(self.rig)} lights, {low:.2f} to {high:.2f}{self.state}>"

    @property
    def state(self) -> str:
        """How far they still changed in the end, in words; empty if they are converged."""
        if self.converged:
            return ""
        size = np.abs(self.change)
        many = int((size > _SETTLED).sum())
        few = many <= _FEW * len(size)
        return (
            f", {many} of which the last round still changed by more than {100 * _SETTLED:g} % "
            f"(up to {100 * size.max():.1f} %): "
            + ("the others have settled" if few else "fit_strengths(lamps.stack) goes on from here")
        )


def fit_strengths(
    stack: Stack,
    *,
    lobes: int = 2,
    index: float = 1.45,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Strengths:
    """Estimate how much light each photograph got, where nothing was measured.

    Lamps of a dome differ, a lamp held by hand comes nearer and goes farther, exposures are set
    anew: what all pixels of a photograph have in common against what the surface should show is
    the strength of its light. In turn the surface is fitted under the lamps (lobes of every pixel's
    own, :func:`fit_sbrdf` with ``pooling="pixel"``) and each lamp's factor becomes the median, over
    the pixels that it lights without clipping, of sample over expected sample. About 10,000 pixels
    spread over the painting are used.

    Photographs of a white board say the same directly (``white=`` of
    :func:`~impasto.read_stack`), and better: whatever a model of the surface lacks under a light
    goes into its factor, and on a painting without relief strengths that grow to one side are
    taken for a tilt.

    Parameters
    ----------
    stack
        At least 6 photographs.
    lobes, index
        As for :func:`fit_sbrdf`.
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
        Fewer lights, or no pixel that can be fitted.

    Notes
    -----
    Semi-calibrated photometric stereo (Cho, Matsushita, Tai and Kweon, CVPR 2016) by alternation,
    with highlights in the model and medians for sums.
    """
    checked_stack(stack)
    lobes, index = lobe_count(lobes), refractive_index(index)
    count = len(stack.rig)
    if count < FEWEST:
        raise ArgumentError(
            f"stack: strengths need at least {FEWEST} lights, found {count}; "
            "photograph a white board under each light (white=)"
        )
    few = thinned_to(stack, _PIXELS)
    samples = np.array([few.linear(photograph) for photograph in range(count)]).mean(axis=1)
    log, step = np.zeros(count), np.zeros(count)
    converged = False
    with reporting(progress, "strengths") as tell:
        for done in range(_ROUNDS):
            if tell is not None:
                tell(done, _ROUNDS)
            lit = few._replace(rig=_scaled(few.rig, np.exp(log)))
            found = fit_lobes(
                lit,
                fit_normals(lit, threads=threads),
                lobes=lobes,
                ambient=True,
                index=index,
                threads=threads,
                progress=False,
            )
            fine = found.status < Status.DARK
            if not fine.any():
                raise ArgumentError("stack: strengths need pixels that can be fitted, found none")
            step = _ratios(samples[:, fine], found.predict(threads=threads).mean(axis=1)[:, fine])
            step = _STRETCH * (step - np.median(step))
            log += step
            log -= np.median(log)
            converged = bool(np.abs(step).max() < _STILL)
            if converged:
                break
        if tell is not None:
            tell(_ROUNDS, _ROUNDS)
    factor: NDArray[np.float64] = np.exp(log)
    factor /= np.median(factor)
    rig = _scaled(stack.rig, factor)
    return Strengths(
        factor=factor,
        rig=rig,
        stack=stack._replace(rig=rig),
        converged=converged,
        change=np.expm1(step),
    )


def _ratios(samples: NDArray[Any], shown: NDArray[Any]) -> NDArray[np.float64]:
    """``(obs,)`` logarithms of the lamps' factors; 0 where too few pixels tell."""
    dim = _DIM * shown.mean(axis=0)
    log = np.zeros(len(samples))
    for photograph, (sample, expected) in enumerate(zip(samples, shown, strict=True)):
        told = np.isfinite(sample) & (sample > 0.0) & (expected > dim)
        if told.any():
            log[photograph] = float(np.median(np.log(sample[told] / expected[told])))
    return log


def _scaled(rig: Rig, factor: NDArray[np.float64]) -> Rig:
    """The rig with intensities times ``factor``."""
    lights = [
        replace(light, intensity=light.intensity * float(by))
        for light, by in zip(rig.lights, factor, strict=True)
    ]
    return Rig(lights, views=rig.views, pitch_mm=rig.pitch_mm)


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
