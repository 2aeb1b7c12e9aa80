"""Lafortune lobes from few photographs: bright nowhere but where photographs say so, and whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Status, simulate
from impasto.simulate.score import normal_error
from oracles import lafortune_forward as oracle

UNSEEN = 64.0
"""How many times what a photograph shows of a lobe any light and view may show."""


def everywhere(count: int) -> impasto.Rig:
    """Lights and views all over the hemisphere, every other view near the mirror direction."""
    rng = np.random.default_rng(0)
    around = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    height = rng.uniform(0.02, 1.0, (2, count))
    side = np.sqrt(1.0 - height**2)
    light, view = np.stack([side * np.cos(around), side * np.sin(around), height], axis=-1)
    view[::2] = light[::2] * (-1.0, -1.0, 1.0) + rng.normal(0.0, 0.05, (count // 2, 3))
    view[:, 2] = np.abs(view[:, 2])
    return impasto.Rig(light, views=view)


def lobe_by_lobe(fit: impasto.LafortuneSbrdf, rig: impasto.Rig) -> np.ndarray:
    """``(lobe, obs, band, y, x)`` what each lobe shows."""
    shapes = [np.nan_to_num(m, nan=1.0) for m in (fit.cxy, fit.cz, fit.exponent)]
    one = [slice(j, j + 1) for j in range(len(fit.specular))]
    dark = np.zeros_like(fit.diffuse)
    return np.array(
        [oracle.stack(fit.normal, dark, fit.specular[j], *(m[j] for m in shapes), rig) for j in one]
    )


@pytest.mark.parametrize("model", ["torrance-sparrow", "lafortune"])
def test_no_light_and_view_show_what_photographs_do_not(model: Any) -> None:
    # Facets are no lobes of Lafortune: fitted to few photographs, these lean to where none looked.
    painting = simulate.painting(seed=2, size=(24, 24), varnish="gloss")
    capture = simulate.capture(painting, "snel-lafortune", "rgb", model=model)
    every = range(0, len(capture.stack.rig), 9)
    few = capture.stack.take(every)
    fit = impasto.fit_sbrdf(few, model="lafortune")
    fine = fit.status < Status.DARK
    assert fine.mean() > 0.99
    # A photograph counts where none of its bands is clipped.
    linear = np.array([few.linear(i) for i in range(len(few.rig))])
    counts = np.isfinite(linear).all(axis=1, keepdims=True)
    seen = np.where(counts, lobe_by_lobe(fit, few.rig), 0.0).max(axis=1)
    # Each lobe stays below 64 times what a photograph shows of it, whose single precision leaves
    # 2e-4 of a power of 1000; beside them there is the diffuse part.
    most = fit.diffuse + UNSEEN * 1.001 * seen.sum(axis=0)
    shown = fit.predict(everywhere(1500))
    assert (shown <= most)[:, :, fine].all()
    # Held-out photographs are predicted better with the lobes.
    held = capture.stack.take(sorted(set(range(len(capture.stack.rig))) - set(every)))
    truth = np.array([held.linear(i) for i in range(len(held.rig))])
    known = np.isfinite(truth) & fine
    matte = oracle.stack(fit.normal, fit.diffuse, *([np.zeros((0, *fit.shape))] * 4), held.rig)
    error, without = (
        np.sqrt(np.mean((image - truth)[known] ** 2)) for image in (fit.predict(held.rig), matte)
    )
    assert error < 0.7 * without


def test_views_tell_normals_that_lights_in_a_plane_do_not() -> None:
    # Of the rig's lights 690 stand in one plane; half of the pixels have no photographs but theirs.
    painting = simulate.painting(seed=7, size=(16, 16), varnish="patches")
    capture = simulate.capture(painting, "snel-lafortune", "rgb")
    every = [*range(0, 690, 4), *range(690, 770)]
    rig = capture.stack.rig.take(every)
    linear = np.array([capture.stack.linear(i) for i in every])
    linear[-80:, :, :, 8:] = np.nan
    fit = impasto.fit_sbrdf(impasto.Stack(linear, lights=rig), model="lafortune")
    stereo = fit.normals.status[:, 8:]
    assert (stereo == Status.RANK_DEFICIENT).all()
    assert (fit.status < Status.DARK).all()
    assert np.isfinite(fit.predict(everywhere(10))).all()
    # Within some times what their neighbours reach, who have 80 photographs more: 0.03 degrees, and
    # 0.1 for 95 %. Photometric stereo, where it has an answer, is off by 15.
    error = normal_error(fit.normal, capture.truth.normal)
    assert np.median(error[:, 8:]) < 0.1
    assert np.percentile(error[:, 8:], 95) < 0.5
    # One view does not determine the normal: such pixels stay open.
    flat = impasto.Rig(np.concatenate([rig.directions[:60], [(0.0, 0.6, 0.8), (0.0, -0.6, 0.8)]]))
    one = simulate.capture(painting, flat, "rgb", model="lafortune").stack
    linear = np.array([one.linear(i) for i in range(62)])
    linear[60:, :, :, 8:] = np.nan
    fit = impasto.fit_sbrdf(impasto.Stack(linear, lights=flat), model="lafortune")
    assert (fit.status[:, 8:] == Status.RANK_DEFICIENT).all()
