"""The steps of the two Tominaga papers, against float64 code written from their text."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import systems
from impasto.overview import gloss_panel
from oracles import papers as oracle

Scene = tuple[Any, impasto.Stack]


@pytest.fixture(scope="module")
def scene() -> Scene:
    samples = oracle.scene()[2]
    bands = ("red", "green", "blue")
    stack = impasto.Stack(samples.astype(np.float32), lights=oracle.lights(), bands=bands)
    return samples, stack


@pytest.fixture(scope="module")
def normals(scene: Scene) -> impasto.Normals:
    return systems.get("tominaga-rgb-camera").fit_normals(scene[1])


def test_the_selected_outputs_are_averaged(scene: Scene, normals: impasto.Normals) -> None:
    samples, stack = scene
    kept = oracle.selection(samples)
    normal, least = oracle.normals(samples, kept)
    np.testing.assert_array_equal(normals.used, kept.sum(axis=0))
    # Nine float32 samples: a few units of 6e-8, times a condition number below 5.
    np.testing.assert_allclose(normals.normal, normal, atol=2e-6)
    expected = oracle.averaged(samples, kept, normal)
    np.testing.assert_allclose(normals.albedo, expected, rtol=3e-6)
    # Least squares is another estimate where a light of the ring is not kept.
    assert np.abs(least / expected[1] - 1.0).max() > 1e-3
    usual = impasto.fit_normals(stack, method="threshold", selection=1)
    np.testing.assert_allclose(usual.albedo[1], least, rtol=3e-6)
    means = (normals.albedo[1].mean(dtype=np.float64), usual.albedo[1].mean(dtype=np.float64))
    np.testing.assert_allclose(means, oracle.ALBEDO, rtol=1e-6)


@pytest.mark.parametrize("extraction", ["papers", "printed"])
def test_equation_10_as_printed_and_as_equation_9_has_it(
    scene: Scene, normals: impasto.Normals, extraction: Any
) -> None:
    name = "printed" if extraction == "printed" else "consistent"

    def fitted(*, peak: bool) -> impasto.PooledSbrdf:
        return impasto.fit_sbrdf(
            scene[1],
            pooling="painting",
            normals=normals,
            extraction=extraction,
            peak=peak,
            joint=False,
        )

    found = fitted(peak=False)
    # The histogram of phi^2 moves the fit by BINNED; single precision by less than 1e-6.
    bound = 1e-6 + oracle.BINNED[extraction == "printed"]
    assert (found.beta, found.gamma) == pytest.approx(oracle.EXPECTED[name], rel=bound)
    near = fitted(peak=True)
    # The region ends with a bin of phi^2: up to 1/4096 / (2 gamma) = 1.1e-3 rad beyond gamma. Fits
    # to regions of 0.8 to 1.2 gamma change gamma by less than half as much: 0.5 %.
    expected = oracle.EXPECTED[f"{name}, peak"]
    assert (near.beta, near.gamma) == pytest.approx(expected, rel=5e-3)
    assert near.gamma < 0.95 * found.gamma


def test_only_the_printed_form_contradicts_the_model() -> None:
    """Without noise and with the true normals, eq. 9 is fitted exactly by its own factor alone."""
    normal, colours, _ = oracle.scene()
    lights, view = oracle.lights(), oracle.VIEW
    clean = [
        oracle.forward.radiance(normal, colours, oracle.BETA, oracle.GAMMA, light, view)
        for light in lights
    ]
    stack = impasto.Stack(np.array(clean, np.float32), lights=lights)
    truth = dataclasses.replace(
        impasto.fit_normals(stack),
        normal=normal.astype(np.float32),
        albedo=colours.astype(np.float32),
    )

    def error(extraction: Any) -> float:
        found = impasto.fit_sbrdf(
            stack, pooling="painting", normals=truth, extraction=extraction, joint=False
        )
        return max(abs(found.beta / oracle.BETA - 1.0), abs(found.gamma / oracle.GAMMA - 1.0))

    # The histogram's (k width)^2 / 24 is 6e-6 at gamma 0.12; single precision adds less.
    assert error("papers") < 2e-5
    assert error("printed") > 1e-2


@pytest.mark.parametrize("extraction", ["maximum", "papers", "printed"])
def test_the_curve_shows_the_samples_that_were_fitted(
    scene: Scene, normals: impasto.Normals, extraction: Any
) -> None:
    def fitted(**options: Any) -> impasto.PooledSbrdf:
        return impasto.fit_sbrdf(
            scene[1], pooling="painting", normals=normals, joint=False, **options
        )

    found = fitted(extraction=extraction)
    pixels = np.prod(oracle.SHAPE)
    # One sample of each pixel; with all samples there would be up to nine.
    assert found.curve[:, 2].sum() == pixels
    assert fitted().curve[:, 2].sum() > 3 * pixels
    near = fitted(extraction=extraction, peak=True)
    assert near.curve[:, 2].sum() < pixels
    assert near.curve[:, 0].max() < 1.02 * near.gamma
    if extraction != "maximum":
        samples, _ = scene
        kept = oracle.selection(samples)
        normal, _ = oracle.normals(samples, kept)
        diffuse = oracle.averaged(samples, kept, normal)
        printed = extraction == "printed"
        phi, values = oracle.specular(samples, normal, diffuse, printed=printed)
        # 200 parts of 1 rad: the mean of the first twenty, within rounding of the part's border.
        part = np.minimum((np.sqrt(((phi**2 * 4096).astype(int) + 0.5) / 4096) * 200), 199)
        part = part.astype(int)
        counts = np.bincount(part, minlength=200)
        means = np.bincount(part, values, 200)[counts > 0] / counts[counts > 0]
        # A sample at the border of a bin may count with the next one.
        np.testing.assert_allclose(found.curve[:, 2], counts[counts > 0], atol=1)
        np.testing.assert_allclose(found.curve[:20, 1], means[:20], rtol=2e-2)
    # The errors are those of as many samples: one per pixel knows less than nine.
    assert found.covariance[0, 0] > fitted().covariance[0, 0] / 9
    assert gloss_panel(found).picture.std() > 1.0


def test_systems_use_the_printed_form_and_the_rgb_paper_s_peak() -> None:
    rgb, six = (
        systems.get(name) for name in ("tominaga-rgb-camera", "tominaga-six-band-adaptation")
    )
    assert (rgb.extraction, rgb.peak, rgb.albedo) == ("printed", True, "mean")
    assert (six.extraction, six.peak, six.albedo) == ("printed", False, "least-squares")
