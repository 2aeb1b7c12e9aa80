"""Spectra of coloured lobes: gilding, measured in one light, in the light of a candle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest

import impasto
from impasto import ArgumentError, DistantLight, Scene
from impasto.colour import xyz_from_spectrum
from impasto.fit.interface import interface_operator, smoothest_reflectance, spectra_of_lobes
from impasto.simulate import camera as simulated_camera
from oracles import forward, metals
from oracles.rigs import spiral

GRID = np.arange(400.0, 701.0, 5.0)
SIZE = (20, 20)
CANDLE = 1900.0
LIGHT = (0.15, 0.2, 0.968)


def candle() -> Any:
    """Planck's law, per nm."""
    metres = GRID * 1e-9
    return metres**-5 / np.expm1(1.4388e-2 / (metres * CANDLE))


def differences(one: Any, other: Any, white: Any) -> Any:
    """CIE DE2000 of XYZ ``(n, 3)``."""
    lab = [colour.XYZ_to_Lab(xyz / white[1], colour.XYZ_to_xy(white)) for xyz in (one, other)]
    return colour.delta_E(lab[0], lab[1], method="CIE 2000")


def test_the_operator_is_that_of_a_minimum_by_its_null_space() -> None:
    """The same minimum without multipliers: over all spectra that the bands do not see."""
    responses = simulated_camera("six-band").operator(GRID)
    found = smoothest_reflectance(responses)
    np.testing.assert_allclose(responses @ found, np.eye(6), atol=1e-9)
    steps = np.diff(np.eye(GRID.size), axis=0)
    some = np.linalg.pinv(responses)
    unseen = np.linalg.svd(responses)[2][6:].T
    free = np.linalg.lstsq(steps @ unseen, -steps @ some)[0]
    # Condition numbers of 1e3 squared in double precision.
    np.testing.assert_allclose(found, some + unseen @ free, atol=1e-8)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-9)


@pytest.mark.parametrize(("name", "mean", "most"), [("six-band", 0.2, 0.3), ("rgb", 0.4, 0.8)])
def test_metals_look_right_by_candlelight(name: str, mean: float, most: float) -> None:
    """A difference of 1 is just seen; a Wiener estimate from paints has 0.4 and 0.9 on average."""
    responses = simulated_camera(name).operator(GRID)
    operator = smoothest_reflectance(responses)
    observer = xyz_from_spectrum(GRID, "E") * candle()
    white = observer.sum(axis=1)
    shown = []
    for metal in metals.CONSTANTS:
        truth = metals.reflectance(metal, GRID)
        estimate = operator @ (responses @ truth)
        assert estimate.min() > 0.0
        shown.append(differences(observer @ estimate, observer @ truth, white))
    assert np.mean(shown) < mean
    assert np.max(shown) < most


def test_no_spectrum_is_negative_and_twice_is_twice() -> None:
    responses = simulated_camera("rgb").operator(GRID)
    basis = np.linalg.svd(np.random.default_rng(1).normal(size=(8, GRID.size)))[2][:8]
    basis[0] = 1.0 / np.sqrt(GRID.size)
    basis = np.linalg.qr(basis.T)[0].T
    operator = interface_operator(responses, basis)
    np.testing.assert_allclose(responses @ basis.T @ operator, np.eye(3), atol=1e-9)
    strength = np.random.default_rng(2).uniform(0.0, 1.0, (3, 5, 7)).astype(np.float32)
    strength[:, 0, 0] = 0.0, 0.0, 1.0
    strength[:, 0, 1] = np.nan
    found = spectra_of_lobes(strength, operator, basis)
    spectra = np.tensordot(basis.T, found.astype(np.float64), axes=1)
    assert np.isnan(found[:, 0, 1]).all()
    # Coefficients in single precision: 6e-8 of a few units.
    assert np.nanmin(spectra) > -1e-6
    assert np.nanmin(np.tensordot(basis.T, np.tensordot(operator, strength, 1), 1)) < -0.05
    twice = spectra_of_lobes(2.0 * strength, operator, basis)
    np.testing.assert_array_equal(twice, 2.0 * found)
    whole = spectra_of_lobes(np.zeros((3, 2, 2), np.float32), operator, basis)
    assert not whole.any()


def gilding(name: str) -> tuple[impasto.Stack, impasto.Camera, Any]:
    """Photographs of four metals side by side under 40 lights, and XYZ by candlelight."""
    camera = simulated_camera(name)
    responses = camera.operator(GRID)
    rng = np.random.default_rng(5)
    normal = np.concatenate([rng.normal(0.0, 0.08, (2, *SIZE)), np.ones((1, *SIZE))])
    normal /= np.linalg.norm(normal, axis=0)
    spectra = np.array([metals.reflectance(metal, GRID) for metal in metals.CONSTANTS])
    which = np.arange(SIZE[1]) * 4 // SIZE[1]
    metal = np.broadcast_to(spectra[which].T[:, None, :], (GRID.size, *SIZE))
    # Bole under the leaf: a reddish brown that is half seen.
    bole = (0.1 + 0.25 / (1.0 + np.exp(-(GRID - 580.0) / 20.0)))[:, None, None] * np.ones(SIZE)

    def shown(light: Any) -> Any:
        """Radiance per wavelength."""
        nothing = np.zeros((1, *SIZE))
        lobe = forward.radiance(normal, nothing, 14.0, 0.25, np.array(light), np.array([0, 0, 1.0]))
        cosine = np.maximum((normal * np.array(light)[:, None, None]).sum(axis=0), 0.0)
        return bole * cosine + metal * lobe

    lights = spiral(40)
    samples = np.array([np.tensordot(responses, shown(light), axes=1) for light in lights])
    stack = impasto.Stack(samples.astype(np.float32), lights=lights, bands=camera.bands)
    truth = np.tensordot(xyz_from_spectrum(GRID, "E") * candle(), shown(LIGHT), axes=1)
    return stack, camera, truth


@pytest.mark.parametrize(("name", "mean"), [("six-band", 0.2), ("rgb", 0.4)])
def test_a_gilded_panel_by_candlelight(name: str, mean: float, tmp_path: Path) -> None:
    stack, camera, truth = gilding(name)
    fitted = impasto.fit_sbrdf(stack, pooling="pixel", ambient=False)
    assert fitted.tinted[0].mean() > 0.7
    reflectance = impasto.fit_reflectance(stack, fitted, camera)
    scene = Scene([DistantLight(LIGHT)], illuminant=CANDLE, exposure=1.0)
    image = impasto.render(fitted, scene, reflectance=reflectance)
    white = (xyz_from_spectrum(GRID, "E") * candle()).sum(axis=1)
    flat = [
        (xyz / xyz_white).reshape(3, -1).T
        for xyz, xyz_white in ((np.asarray(image.xyz), 1.0), (truth, white[1]))
    ]
    assert np.mean(differences(*flat, white / white[1])) < mean
    reflectance.save(tmp_path / "spectra.npz")
    again = impasto.Reflectance.load(tmp_path / "spectra.npz")
    same = impasto.render(fitted, scene, reflectance=again)
    assert same.linear.tobytes() == image.linear.tobytes()
    old = replace(reflectance, interface=None)
    with pytest.raises(ArgumentError, match="reflectance: the lobes of a LobeSbrdf"):
        impasto.render(fitted, scene, reflectance=old)
