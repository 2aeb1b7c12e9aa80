"""Simulated photographs against an independent forward model, one degradation at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from impasto import PointLight, Rig, simulate
from impasto.errors import ArgumentError, GeometryError
from oracles import forward as oracle

OFF: dict[str, Any] = {"noise": False, "bits": None, "clip": False}


def forward(normal: Any, diffuse: Any, beta: Any, gamma: Any, rig: Rig) -> Any:
    return oracle.stack(normal, diffuse, beta, gamma, rig)


@pytest.fixture(scope="module")
def painting() -> simulate.Painting:
    return simulate.painting(seed=5, size=(72, 88))


@pytest.fixture(scope="module")
def clean(painting: simulate.Painting) -> np.ndarray:
    """Noiseless radiance (obs, band, y, x) of the nine-light rig by the oracle."""
    rig = simulate.rig("tominaga-rgb-camera")
    diffuse = painting.reflectance_in(simulate.camera("rgb"))
    return oracle.stack(painting.normal, diffuse, painting.beta, painting.gamma, rig)


def shoot(painting: simulate.Painting, **options: Any) -> simulate.Capture:
    return simulate.capture(painting, "tominaga-rgb-camera", forward=forward, **options)


def linear(capture: simulate.Capture) -> np.ndarray:
    return np.array([capture.stack.linear(i) for i in range(len(capture.stack.rig))])


def test_rigs() -> None:
    nine = simulate.rig("tominaga-rgb-camera").directions
    assert np.allclose(nine[0], (0, 0, 1))
    assert np.allclose(np.degrees(np.arcsin(nine[1:, 2])), 45)
    azimuth = np.degrees(np.arctan2(nine[1:, 1], nine[1:, 0])) % 360
    assert np.allclose((azimuth - np.arange(0, 360, 45) + 180) % 360, 180)
    sixteen = simulate.rig("tominaga-six-band-adaptation").directions
    assert len(sixteen) == 16
    assert np.degrees(np.arcsin(sixteen[:, 2])).min() > 44.9
    near = simulate.rig("tominaga-rgb-camera", distance_mm=700.0)
    assert np.allclose([np.linalg.norm(light.position) for light in near.lights], 700)  # type: ignore[union-attr]
    with pytest.raises(ArgumentError, match="name"):
        simulate.rig("ring")
    with pytest.raises(ArgumentError, match="distance_mm"):
        simulate.rig("tominaga-rgb-camera", distance_mm=-1.0)


@pytest.mark.parametrize(("name", "bands"), [("rgb", 3), ("six-band", 6)])
def test_cameras_see_white_as_one(name: str, bands: int) -> None:
    camera = simulate.camera(name)
    white = camera.response(np.ones(81), np.arange(380.0, 781.0, 5.0))
    assert white.shape == (bands,)
    assert np.allclose(white, 1.0, rtol=0, atol=1e-12)
    with pytest.raises(ArgumentError, match="name"):
        simulate.camera("infrared")


def test_everything_off_is_the_equation(painting: simulate.Painting, clean: np.ndarray) -> None:
    capture = shoot(painting, **OFF)
    assert capture.stack.samples.dtype == np.float32
    # The painting stores float32 maps and the stack float32 samples: two roundings.
    assert np.allclose(linear(capture), clean, rtol=3e-7, atol=1e-7)
    assert capture.truth.normal is painting.normal
    assert capture.truth.diffuse.shape == (3, 72, 88)


def test_quantised_to_half_a_code(painting: simulate.Painting, clean: np.ndarray) -> None:
    capture = shoot(painting, noise=False, bits=12, exposure=0.5)
    assert capture.stack.samples.dtype == np.uint16
    assert capture.stack.samples.max() <= 4095
    value = linear(capture)
    inside = np.isfinite(value)
    # Half a code, and values up to 2 are rounded to float32 (2^-23) before and after.
    step = 1.0 / (0.5 * 4095)
    assert np.abs(value - clean)[inside].max() <= 0.5 * step + 2 * 2.0**-23
    assert (clean[~inside] >= (1 - 0.5 / 4095) / 0.5 - 1e-6).all()
    assert np.array_equal(inside, capture.stack.samples < 4095)


def test_exposure_clips_or_is_lowered(painting: simulate.Painting, clean: np.ndarray) -> None:
    clipped = shoot(painting, noise=False, exposure=1.0)
    assert np.isinf(linear(clipped)).any()
    lowered = shoot(painting, noise=False, exposure=1.0, clip=False)
    assert np.isfinite(linear(lowered)).all()
    assert lowered.truth.exposure == pytest.approx(0.95 / clean.max(), rel=1e-6)
    floats = shoot(painting, noise=False, bits=None, exposure=1.0)
    assert np.isinf(linear(floats)).sum() == (clean.astype(np.float32) >= 1.0).sum()


def test_noise_has_the_sensors_variance(painting: simulate.Painting, clean: np.ndarray) -> None:
    sensor = simulate.Noise(full_well=20000.0, read=8.0)
    capture = shoot(painting, noise=sensor, bits=None, exposure=0.5, frames=2, clip=False)
    exposure = capture.truth.exposure
    electrons = clean * exposure * sensor.full_well
    expected = np.sqrt((electrons + sensor.read**2) / 2) / sensor.full_well / exposure
    score = (linear(capture) - clean) / expected
    # 171,072 independent scores: mean within 4 / sqrt(n), deviation within 4 / sqrt(2 n).
    n = score.size
    assert abs(score.mean()) < 4 / np.sqrt(n)
    assert abs(score.std() - 1) < 4 / np.sqrt(2 * n)
    dark, light = electrons < np.median(electrons), electrons >= np.median(electrons)
    assert abs(score[dark].std() - 1) < 4 / np.sqrt(n)
    assert abs(score[light].std() - 1) < 4 / np.sqrt(n)


def test_noise_is_repeatable_and_not_shared(painting: simulate.Painting) -> None:
    first, again = shoot(painting), shoot(painting)
    assert first.stack.samples.tobytes() == again.stack.samples.tobytes()
    other = shoot(painting, seed=6)
    assert (other.stack.samples != first.stack.samples).mean() > 0.5
    # One observation's noise does not depend on which others were taken.
    alone = simulate.capture(
        painting, simulate.rig("tominaga-rgb-camera").take([0]), "rgb", forward=forward
    )
    assert np.array_equal(alone.stack.samples[0], first.stack.samples[0])


def test_darks_are_not_cut_at_zero() -> None:
    p = simulate.painting(seed=5, size=(60, 60), varnish=None)
    capture = shoot(p, noise=simulate.Noise(full_well=20000.0, read=80.0), exposure=0.2)
    clean = shoot(p, **OFF)
    error = linear(capture) - linear(clean)
    shade = linear(clean) < np.percentile(linear(clean), 10)
    spread = error[shade].std() / np.sqrt(shade.sum())
    assert abs(error[shade].mean()) < 4 * spread


@pytest.mark.parametrize("encoding", ["srgb", "2.2"])
def test_coded_photographs(painting: simulate.Painting, clean: np.ndarray, encoding: str) -> None:
    capture = shoot(painting, noise=False, bits=8, exposure=0.8, encoding=encoding)
    stack = capture.stack
    assert np.allclose(stack.rig.intensities, 0.8)
    coded = stack.encoding.encode(stack.samples)
    # Decoded samples sit on 8-bit codes (float32 rounding of a code below 256: 256 * 2^-22).
    assert np.abs(coded - np.rint(coded)).max() < 1e-3
    expected = stack.encode(clean * 0.8)
    assert np.abs(coded - expected).max() < 0.5 + 1e-3


def test_near_lights(painting: simulate.Painting) -> None:
    rig = simulate.rig("tominaga-rgb-camera", distance_mm=60.0)
    capture = simulate.capture(painting, rig, "rgb", forward=forward, **OFF)
    middle, corner = linear(capture)[0, 1, 36, 44], linear(capture)[0, 1, 0, 0]
    flat = simulate.capture(painting, rig, "rgb", forward=forward, falloff=False, **OFF)
    lit = np.array([[(0 - 43.5) * 0.2, (35.5 - 0) * 0.2, 0.0], [0.1, -0.1, 0.0]])
    squared = ((np.array([0.0, 0.0, 60.0]) - lit) ** 2).sum(axis=1)
    assert corner / linear(flat)[0, 1, 0, 0] == pytest.approx(3600 / squared[0], rel=1e-6)
    assert middle / linear(flat)[0, 1, 36, 44] == pytest.approx(3600 / squared[1], rel=1e-6)
    assert isinstance(capture.stack.rig.lights[0], PointLight)


def test_coats_add() -> None:
    p = simulate.painting(seed=5, size=(40, 40), layers=2)
    capture = shoot(p, **OFF)
    rig = capture.truth.rig
    expected = oracle.stack(p.normal, capture.truth.diffuse, p.beta, p.gamma, rig)
    assert np.allclose(linear(capture), expected, rtol=3e-7, atol=1e-7)


@pytest.mark.parametrize("name", ["tominaga-rgb-camera", "tominaga-six-band-adaptation"])
@pytest.mark.parametrize("distance", [None, 80.0])
def test_the_numerics_agree_with_the_equation(name: str, distance: float | None) -> None:
    p = simulate.painting(seed=5, size=(48, 56), varnish="patches", layers=2)
    rig = simulate.rig(name, distance_mm=distance)
    fast = simulate.capture(p, rig, name, **OFF)
    slow = simulate.capture(p, rig, name, forward=forward, **OFF)
    # Float32 against float64. The gloss is the sensitive term: D is steepest where phi = gamma /
    # sqrt(2 ln 2), by sqrt(2 ln 2 / e) / gamma = 9.5 per radian; half a dozen float32 operations
    # on unit vectors leave 4e-7 rad, so 4e-6 of a highlight of about white. Four times that.
    error = np.abs(linear(fast) - linear(slow))
    assert error.max() < 1.6e-5
    assert error.mean() < 1e-6


def test_a_wall_casts_its_shadow(painting: simulate.Painting) -> None:
    height = np.zeros(painting.size, np.float32)
    height[:, 60:] = 2.0
    walled = replace(painting, height=height)
    rig = Rig([(1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)], pitch_mm=painting.pitch_mm)
    dark = linear(simulate.capture(walled, rig, "rgb", forward=forward, shadows=True, **OFF))
    lit = linear(simulate.capture(walled, rig, "rgb", forward=forward, **OFF))
    # 2 mm under 45 degrees: 2 mm of shadow, 10 pixels of 0.2 mm, on the side away from the light.
    # One pixel to either side belongs to the slope that joins the two levels.
    assert (dark[0, :, :, 51:59] == 0).all()
    assert np.array_equal(dark[0, :, :, :48], lit[0, :, :, :48])
    assert np.array_equal(dark[0, :, :, 61:], lit[0, :, :, 61:])
    assert np.array_equal(dark[1], lit[1])


def test_refusals(painting: simulate.Painting) -> None:
    for options, name in (
        ({"bits": 0}, "bits"),
        ({"bits": 17}, "bits"),
        ({"exposure": 0.0}, "exposure"),
        ({"frames": 0}, "frames"),
        ({"sensitivity": (1.0, 0.5)}, "sensitivity"),
        ({"sensitivity": (1.0, 0.5, 0.0)}, "sensitivity"),
        ({"encoding": "log"}, "encoding"),
    ):
        with pytest.raises(ArgumentError, match=f"^{name}:"):
            shoot(painting, **options)
    with pytest.raises(GeometryError, match=r"^rig:"):
        simulate.capture(painting, simulate.rig("tominaga-rgb-camera", pitch_mm=0.5), "rgb")
    with pytest.raises(ArgumentError, match="full_well"):
        simulate.Noise(full_well=0.0)
