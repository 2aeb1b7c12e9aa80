"""All checks, from reading to the tone curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto.doctor.diagnosis import Diagnosis, Finding
from impasto.doctor.directions import directions, in_doubt
from impasto.doctor.exposure import Exposure, exposure
from impasto.doctor.lights import lights
from impasto.doctor.order import AT_RANDOM, misfit_of, order
from impasto.doctor.pairing import exchanged, measure_similarity, pairing
from impasto.doctor.photographs import duplicates, reading
from impasto.doctor.sampled_tiles import SampledTiles
from impasto.doctor.strength import strengths
from impasto.doctor.surface import fit_surface
from impasto.doctor.tone import tone
from impasto.stack import Stack


def examine(stack: Stack) -> Diagnosis:
    """Check a stack before a fit; every finding says what to do.

    Examines tiles of at most 40,000 pixels and an even grid of at most 200,000 pixels of each
    photograph, so that a stack of any size takes seconds. The same stack always gets the same
    diagnosis. Faults of the samples never raise an error.

    Parameters
    ----------
    stack
        A stack, as from :func:`impasto.read_stack`; its notes become findings.

    Returns
    -------
    Diagnosis
        ``print`` it, or read its ``.findings``. Its ``.worst`` is ``"error"`` if results would
        be wrong.
    """
    measured = Exposure.of(stack)
    found: list[Finding] = [
        *reading(stack),
        *exposure(stack, measured),
        *lights(stack),
    ]
    sampled = SampledTiles.of(stack)
    surface = surface_of(sampled, stack.rig.directions)
    similarity = measure_similarity(sampled)
    found += duplicates(stack, sampled, similarity)
    if surface is not None:
        one_view = not _core.views_differ(RigArguments.of(stack.rig))
        out_of_step, right_order = order(sampled, one_view=one_view)
        if right_order is not None:
            repaired = exchanged(sampled, similarity, stack.rig.directions)
            given = np.arange(len(stack.rig))
            # A shift within a ring is an exchange and a rotation, which no misfit shows.
            limit = 0.9 * misfit_of(sampled, right_order)
            if repaired is not None and misfit_of(repaired, given) < limit:
                out_of_step, right_order = order(repaired)
        found += out_of_step
        if right_order is not None:
            # Under wrong lights all further checks fail: continue with the right order.
            stack = stack._replace(rig=stack.rig.take(right_order.tolist()))
            sampled = replace(sampled, lights=sampled.lights[right_order])
            surface = fit_surface(sampled.grey, sampled.lights)
        checked = directions(sampled, surface, stack.rig.directions)
        at_random = any(finding.numbers.get("verdict") == AT_RANDOM for finding in out_of_step)
        found += map(in_doubt, checked) if at_random else checked
        found += pairing(stack, sampled, similarity)
        found += strengths(stack, sampled)
        found += tone(stack)
    return Diagnosis(tuple(found), stack.names, stack.shape)


def surface_of(sampled: SampledTiles, directions: NDArray[np.float64]) -> np.ndarray | None:
    """A surface for the further checks, or None if the lights do not determine one."""
    if len(directions) < 3 or np.linalg.matrix_rank(directions, tol=1e-3) < 3:
        return None
    surface = fit_surface(sampled.grey, sampled.lights)
    return surface if np.isfinite(surface).all(axis=0).sum() >= 30 else None
