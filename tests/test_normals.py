"""Normals and albedo, against an independent double-precision fit written from the papers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Status
from impasto.fit.normals import METHODS
from oracles import stereo as oracle
from processes import run

SHAPE = (12, 23)


def dome(count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (count, 3), 20 to 80 degrees above the painting."""
    elevation = np.radians(rng.uniform(20, 80, count))
    azimuth = np.arange(count) * 2.399963 + rng.uniform(0, 1)
    return np.stack(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ],
        axis=1,
    )


def surface(rng: np.random.Generator, bands: int, tilt: float = 0.25) -> tuple[Any, Any]:
    slopes = rng.normal(0.0, tilt, (2, *SHAPE))
    normal = np.stack([*slopes, np.ones(SHAPE)])
    normal /= np.linalg.norm(normal, axis=0)
    return normal, rng.uniform(0.05, 0.9, (bands, *SHAPE))


def photographs(
    rng: np.random.Generator, lights: np.ndarray, bands: int = 1, noise: float = 0.005
) -> np.ndarray:
    """Matte samples (obs, band, y, x) with noise, a highlight here and a shadow there."""
    normal, albedo = surface(rng, bands)
    shading = np.maximum(np.einsum("oc,cyx->oyx", lights, normal), 0.0)
    samples = shading[:, None] * albedo
    samples += noise * rng.standard_normal(samples.shape)
    glint = rng.random((len(lights), 1, *SHAPE)) < 0.08
    samples = np.where(glint, samples + 0.7, samples)
    shadow = rng.random((len(lights), 1, *SHAPE)) < 0.06
    return np.where(shadow, 0.02 * samples, samples).astype(np.float32)


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between vectors along the first axis, rad; exact for small ones."""
    return np.arctan2(np.linalg.norm(np.cross(a, b, axis=0), axis=0), (a * b).sum(axis=0))


def compare(stack: impasto.Stack, linear: np.ndarray, lights: np.ndarray, **options: Any) -> int:
    """Every pixel against the oracle; how many were too close to a threshold to compare."""
    method = options.pop("method", "robust")
    learned = impasto.learn_normals(stack, selection=options.get("selection"))
    fit = impasto.fit_normals(stack, method=method, learned=learned, **options)
    oracle_options = {k: v for k, v in options.items() if k != "threads"}
    oracle_options["typical"] = learned.scale
    skipped = 0
    for y, x in np.ndindex(fit.status.shape):
        samples = linear[:, :, y, x].astype(np.float64)
        towards = lights if lights.ndim == 2 else lights[:, :, y, x]
        exact = oracle.fit_pixel(samples, towards, method, **oracle_options)
        where = f"{method} at {(y, x)}"
        # A sample within single precision of a threshold may fall on either side of it.
        if exact.margin < 1e-5:
            skipped += 1
            continue
        assert Status(fit.status[y, x]).name == exact.status, where
        assert fit.used[y, x] == exact.kept.sum(), where
        if exact.status in {"DARK", "RANK_DEFICIENT", "SATURATED", "INVALID_INPUT"}:
            assert np.isnan(fit.normal[:, y, x]).all(), where
            continue
        # Single precision: sums of n products lose some 1e-7 of the largest term; the inverse
        # multiplies that by the condition number of the normal equations, which the loss's weights
        # (1e-3 at least for l1, 0 for tukey) can raise 30-fold over the square of the lights'.
        steep = method in {"robust", "trimmed", "l1"}
        reweighted = method not in {"least-squares", "threshold", "rank"}
        tolerance = 1e-6 * exact.condition**2 * (30 if reweighted else 1)
        assert angle(fit.normal[:, y, x], exact.normal) < tolerance, where
        albedo = oracle.band_albedo(samples, towards, exact)
        # Weights 1 / |R| of samples that the fit goes through know R to 6e-8 of the sample, some
        # percent of the smallest |R| that counts (1e-3 of the noise); so bands, whose residuals
        # along the shared normal are the noise's, may differ by percents of it.
        slack = 0.05 * np.nan_to_num(exact.residual) if steep else 0.0
        np.testing.assert_allclose(
            fit.albedo[:, y, x], albedo, atol=tolerance * exact.albedo + slack, err_msg=where
        )
        np.testing.assert_allclose(fit.condition[y, x], exact.condition, rtol=1e-3, err_msg=where)
        if exact.status == "EXACT":
            assert np.isnan(fit.residual[y, x]), where
            assert np.isnan(fit.sigma[y, x]), where
            continue
        np.testing.assert_allclose(
            fit.residual[y, x], exact.residual, rtol=1e-3, atol=tolerance * exact.albedo
        )
        assert np.isfinite(fit.sigma[y, x]), where
    return skipped


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [5, 9, 16, 33])
def test_every_method_agrees_with_its_definition(method: str, count: int) -> None:
    rng = np.random.default_rng(count)
    lights = dome(count, rng)
    samples = photographs(rng, lights)
    skipped = compare(impasto.Stack(samples, lights=lights), samples, lights, method=method)
    assert skipped < 5


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_bands_share_a_normal_and_clipped_bands_take_the_others_with_them(method: str) -> None:
    rng = np.random.default_rng(2)
    lights = dome(14, rng)
    samples = photographs(rng, lights, bands=3)
    clipped = np.where(samples >= 0.8, np.inf, samples)
    stack = impasto.Stack(samples, lights=lights, saturation=0.8)
    assert compare(stack, clipped, lights, method=method) < 5
    assert compare(stack, clipped, lights, method=method, selection=1) < 5
    fit = impasto.fit_normals(stack, method=method)
    expected = np.isinf(clipped).any(axis=1).sum(axis=0)
    np.testing.assert_array_equal(fit.rejected[0], expected)
    np.testing.assert_array_equal(fit.used + fit.rejected.sum(axis=0), 14)
    by_name = impasto.fit_normals(stack, method=method, selection="green")
    by_number = impasto.fit_normals(stack, method=method, selection=1)
    assert by_name.normal.tobytes() == by_number.normal.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_near_lights_have_their_own_direction_at_every_pixel(method: str) -> None:
    rng = np.random.default_rng(3)
    positions = 60.0 * dome(12, rng) + rng.normal(0.0, 3.0, (12, 3))
    lights = [impasto.PointLight(tuple(p), falloff=i % 3 > 0) for i, p in enumerate(positions)]
    rig = impasto.Rig(lights, pitch_mm=1.5)
    normal, albedo = surface(rng, 1)
    rows, columns = SHAPE
    x = (np.arange(columns) - (columns - 1) / 2) * 1.5
    y = ((rows - 1) / 2 - np.arange(rows)) * 1.5
    points = np.stack([*np.meshgrid(x, y), np.zeros(SHAPE)])
    reach = positions[:, :, None, None] - points
    length = np.linalg.norm(reach, axis=1, keepdims=True)
    falloff = np.array([light.falloff for light in lights])[:, None, None, None]
    r0 = np.linalg.norm(positions, axis=1)[:, None, None, None]
    towards = reach / length * np.where(falloff, (r0 / length) ** 2, 1.0)
    samples = np.maximum((towards * normal).sum(axis=1), 0)[:, None] * albedo
    samples += 0.003 * rng.standard_normal(samples.shape)
    samples = samples.astype(np.float32)
    stack = impasto.Stack(samples, lights=rig)
    assert compare(stack, samples, towards, method=method) < 5


def test_the_paper_s_top_light_is_highlight_on_a_flat_matte_pixel() -> None:
    ring = [[np.cos(a), np.sin(a), 1.0] for a in np.arange(8) * np.pi / 4]
    lights = np.array([[0.0, 0.0, 1.0], *ring])
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    samples = np.broadcast_to(lights[:, 2, None, None], (9, 2, 2)).astype(np.float32)
    fit = impasto.fit_normals(impasto.Stack(samples, lights=lights), method="threshold")
    # 1 / mean(1, 8 cos 45) = 1.35 > 1.2.
    np.testing.assert_array_equal(fit.rejected[3], 1)
    np.testing.assert_array_equal(fit.used, 8)
    np.testing.assert_allclose(fit.normal[2], 1.0, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_crops_of_the_icon_agree(method: str, data: Path) -> None:
    stack = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
    crop = impasto.Stack(
        np.ascontiguousarray(stack.samples[:, :, 200:206, 190:197]),
        lights=stack.rig,
        saturation=stack.saturation,
        scale=stack.scale,
        black=stack.black,
    )
    linear = np.stack([crop.linear(i) for i in range(len(crop.rig))])
    directions = np.array([light.direction for light in crop.rig.lights])
    compare(crop, linear, directions, method=method)


@pytest.mark.parametrize("method", METHODS)
def test_threads_tiles_and_pixel_order_change_nothing(method: str) -> None:
    rng = np.random.default_rng(4)
    lights = dome(11, rng)
    samples = np.concatenate([photographs(rng, lights, bands=2) for _ in range(60)], axis=2)
    samples[3, :, 100:105, 7] = np.nan
    whole = impasto.Stack(samples, lights=lights)
    options: dict[str, Any] = {"method": method, "learned": impasto.learn_normals(whole)}
    one = impasto.fit_normals(whole, method=method, threads=1)
    maps = ["normal", "albedo", "used", "rejected", "residual", "condition", "sigma", "status"]
    for threads in (2, 3, 5):
        fit = impasto.fit_normals(whole, method=method, threads=threads)
        for name in maps:
            assert getattr(fit, name).tobytes() == getattr(one, name).tobytes(), name
    order = rng.permutation(samples[0, 0].size)
    shuffled = samples.reshape(*samples.shape[:2], -1)[:, :, order].reshape(samples.shape)
    fit = impasto.fit_normals(impasto.Stack(shuffled, lights=lights), **options)
    for name in maps:
        here, there = getattr(fit, name), getattr(one, name)
        planes = there.reshape(*there.shape[:-2], -1)[..., order]
        assert here.tobytes() == planes.tobytes(), name


SCRIPT = """
import hashlib, sys
import numpy as np, impasto
rng = np.random.default_rng(5)
lights = rng.normal(size=(13, 3)) * [1, 1, 0.2] + [0, 0, 1]
samples = rng.uniform(0, 1, (13, 3, 40, 57)).astype(np.float32)
samples[2, :, 5] = np.nan
stack = impasto.Stack(samples, lights=lights, saturation=0.98)
digest = hashlib.sha256()
for method in sys.argv[1:]:
    fit = impasto.fit_normals(stack, method=method)
    for name in ("normal", "albedo", "used", "residual", "condition", "sigma", "status"):
        digest.update(getattr(fit, name).tobytes())
print(digest.hexdigest(), impasto._core.build_info()["simd"])
"""


@pytest.mark.slow
def test_every_instruction_set_gives_the_same_bits() -> None:
    found: dict[str, str] = {}
    for level in ("baseline", "avx2", "avx512"):
        digest, simd = run(SCRIPT, *METHODS, IMPASTO_SIMD=level).split()
        found[simd] = digest
    assert len(set(found.values())) == 1, found


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16])
def test_stored_types_mean_what_they_say(dtype: Any) -> None:
    rng = np.random.default_rng(6)
    lights = dome(10, rng)
    linear = np.clip(photographs(rng, lights), 0, 1)
    full = 1.0 if dtype == np.float16 else float(np.iinfo(dtype).max)
    stored = np.rint(linear * full).astype(dtype) if full > 1 else linear.astype(dtype)
    fit = impasto.fit_normals(impasto.Stack(stored, lights=lights, saturation=full))
    floats = np.where(stored >= full, np.inf, stored.astype(np.float64) / full)
    exact = impasto.fit_normals(impasto.Stack(floats.astype(np.float32), lights=lights))
    np.testing.assert_array_equal(fit.status, exact.status)
    # u / full and u * (1 / full) differ by two roundings of 6e-8.
    good = exact.status == 0
    assert angle(fit.normal, exact.normal)[good].max() < 1e-4


def test_intensities_are_divided_out() -> None:
    rng = np.random.default_rng(7)
    lights = dome(8, rng)
    samples = photographs(rng, lights)
    strength = 2.0 ** rng.integers(-2, 3, 8)
    rig = impasto.Rig(
        [impasto.DistantLight(tuple(d), intensity=s) for d, s in zip(lights, strength, strict=True)]
    )
    brighter = (samples * strength[:, None, None, None]).astype(np.float32)
    plain = impasto.fit_normals(impasto.Stack(samples, lights=lights))
    lit = impasto.fit_normals(impasto.Stack(brighter, lights=rig))
    assert plain.normal.tobytes() == lit.normal.tobytes()
    assert plain.albedo.tobytes() == lit.albedo.tobytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "median"}, "method: expected 'robust' or 'least-squares'"),
        ({"method": "rnak"}, "did you mean 'rank'"),
        ({"method": "rank", "low": 0.8, "high": 0.2}, "high: expected more than low = 0.8"),
        ({"method": "rank", "low": -0.1}, "low: expected at least 0"),
        ({"method": "rank", "high": 1.5}, "high"),
        ({"method": "rank", "low": float("nan")}, "low"),
        ({"method": "threshold", "w1": -1.0}, "w1: expected a positive number, found -1"),
        ({"method": "threshold", "w2": 1.3}, "w2: expected at least 0 and less than w1 = 1.2"),
        ({"low": "dark"}, "low: expected a number, found 'dark'"),
        ({"steps": -1}, "steps: expected a number from 0"),
        ({"steps": 2.5}, "steps"),
        ({"selection": "infrared"}, 'selection: expected a band \\("grey"\\)'),
        ({"selection": 1}, "selection"),
        ({"threads": 0}, "threads"),
        ({"progress": 3}, "progress"),
    ],
)
def test_a_wrong_call_names_the_argument(options: dict[str, Any], message: str) -> None:
    rng = np.random.default_rng(8)
    lights = dome(6, rng)
    stack = impasto.Stack(photographs(rng, lights), lights=lights)
    with pytest.raises(impasto.ArgumentError, match=message):
        impasto.fit_normals(stack, **options)


def test_progress_reaches_the_last_tile() -> None:
    calls: list[tuple[int, int]] = []
    lights = dome(6, np.random.default_rng(9))
    stack = impasto.Stack(np.ones((6, 100, 100), np.float32), lights=lights)
    impasto.fit_normals(stack, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (3, 3)
