"""The pooled lobe: against SciPy in double precision, and through the hard cases.

Numbers of hard cases are those of ``docs/numerics``.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Effort, Status
from impasto.fit.learned import LearnedLobe, PooledMaps
from impasto.fit.pooled import apply_pooled, learn_pooled
from oracles import forward
from oracles import pooled as oracle
from processes import run

ROWS, COLUMNS = SHAPE = (24, 32)
BETA, GAMMA = 11.0, 0.13


def surface(seed: int = 1, tilt: float = 0.17) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    normal = np.stack([*rng.normal(0.0, tilt, (2, *SHAPE)), np.ones(SHAPE)])
    normal /= np.linalg.norm(normal, axis=0)
    return normal, rng.uniform(0.05, 0.7, (3, *SHAPE))


def photographs(
    beta: float = BETA, gamma: float = GAMMA, lights: Any = None, noise: float = 0.004
) -> Any:
    """Float32 samples by the oracle's forward model, with shot noise."""
    normal, diffuse = surface()
    rig = impasto.Rig(oracle.lights() if lights is None else lights)
    clean = forward.stack(normal, diffuse, np.full(SHAPE, beta), np.full(SHAPE, gamma), rig)
    rng = np.random.default_rng(2)
    return (clean + noise * np.sqrt(clean) * rng.standard_normal(clean.shape)).astype(np.float32)


def stack_of(samples: Any, lights: Any = None, **options: Any) -> impasto.Stack:
    return impasto.Stack(samples, lights=oracle.lights() if lights is None else lights, **options)


def tilt_error(fitted: impasto.PooledSbrdf) -> Any:
    return np.degrees(np.linalg.norm(fitted.normal - surface()[0], axis=0))


def check_maps(fitted: impasto.PooledSbrdf) -> None:
    """NaN exactly where the status says so, and nothing infinite."""
    lost = fitted.status >= 16
    dark = fitted.status == Status.DARK
    for name in ("normal", "residual", "sigma", "misfit"):
        values = getattr(fitted, name)
        np.testing.assert_array_equal(np.isnan(values), np.broadcast_to(lost, values.shape), name)
        assert not np.isinf(values).any(), name
    np.testing.assert_array_equal(
        np.isnan(fitted.diffuse), np.broadcast_to(lost & ~dark, fitted.diffuse.shape)
    )
    assert np.isfinite([fitted.beta, fitted.gamma]).all()
    assert not np.isnan(fitted.covariance).any()


@pytest.fixture(scope="module")
def plain() -> impasto.PooledSbrdf:
    return impasto.fit_sbrdf(stack_of(photographs()), pooling="painting")


@pytest.mark.parametrize("far", [20.0, 60.0])
def test_normals_that_begin_far_away_end_where_the_others_do(
    plain: impasto.PooledSbrdf, far: float
) -> None:
    """A highlight that was taken for shading, in a fifth of the pixels; the others begin well."""
    stack = stack_of(photographs())
    begin = impasto.fit_normals(stack)
    lights = np.array(oracle.lights())
    brightest = lights[np.argmax(stack.samples.mean(axis=1), axis=0)].transpose(2, 0, 1)
    across = brightest - (brightest * begin.normal).sum(axis=0) * begin.normal
    across /= np.linalg.norm(across, axis=0)
    leaning = np.cos(np.radians(far)) * begin.normal + np.sin(np.radians(far)) * across
    wrong = np.arange(ROWS * COLUMNS).reshape(SHAPE) % 5 == 0
    normal = np.where(wrong, leaning, begin.normal).astype(np.float32)
    fitted = impasto.fit_sbrdf(
        stack, normals=dataclasses.replace(begin, normal=normal), pooling="painting"
    )
    # A search ends where a step lowers the squared scale by less than 2e-5 of it. The scale of some
    # fifty samples rises by a fiftieth at one standard deviation of the normal, and by the square
    # of the distance: what is left is sqrt(50 * 2e-5), a thirtieth of it, after the last step, and
    # some times as much where steps shrink slowly.
    apart = np.linalg.norm(fitted.normal - plain.normal, axis=0)
    assert np.quantile(apart / plain.sigma, 0.99) < 0.1
    assert (apart < plain.sigma).all()


# Against SciPy ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scene() -> tuple[Any, Any, impasto.Stack]:
    slopes, colours, samples = oracle.scene()
    samples = samples.reshape(-1, oracle.BANDS, *oracle.SHAPE).astype(np.float32)
    return slopes, colours, stack_of(samples)


def truth(scene: tuple[Any, Any, impasto.Stack]) -> impasto.Normals:
    slopes, colours, stack = scene
    return dataclasses.replace(
        impasto.fit_normals(stack),
        normal=oracle.unit(slopes).reshape(3, *oracle.SHAPE).astype(np.float32),
        albedo=colours.reshape(oracle.BANDS, *oracle.SHAPE).astype(np.float32),
    )


def test_the_separate_fit_is_minpacks(scene: tuple[Any, Any, impasto.Stack]) -> None:
    fitted = impasto.fit_sbrdf(scene[2], normals=truth(scene), joint=False)
    beta, gamma = oracle.EXPECTED["separate"]
    # The histogram of phi^2 is wrong by (k width)^2 / 24 = 4e-6 at gamma = 0.13; single precision
    # adds less.
    assert fitted.beta == pytest.approx(beta, rel=2e-5)
    assert fitted.gamma == pytest.approx(gamma, rel=2e-5)


@pytest.mark.parametrize("start", ["stereo", "truth"])
def test_the_joint_fit_is_the_robust_minimum(
    scene: tuple[Any, Any, impasto.Stack], start: str
) -> None:
    fitted = impasto.fit_sbrdf(
        scene[2], normals=truth(scene) if start == "truth" else None, pooling="painting"
    )
    beta, gamma = oracle.EXPECTED["joint_robust"]
    # The search ends where a step lowers the cost by less than 1e-6 of it: with
    # 174 (d beta / beta)^2 (joint.rs) that is 7.6e-5, a fifteenth of a standard deviation.
    assert fitted.beta == pytest.approx(beta, rel=1e-4)
    assert fitted.gamma == pytest.approx(gamma, rel=1e-4)
    # Least squares on the same samples is another estimate: half a standard deviation apart.
    deviations = np.sqrt(np.diag(fitted.covariance))
    least = oracle.EXPECTED["joint_least_squares"]
    assert abs(np.log(fitted.beta / least[0])) < deviations[0]
    assert abs(np.log(fitted.gamma / least[1])) < deviations[1]
    # Errors estimated from the gradients of 120 pixels scatter by 1 / sqrt(2 * 120) = 6 % and more,
    # as gradients are far from normal; the robust estimate's own are some 10 % larger.
    np.testing.assert_allclose(deviations, oracle.DEVIATIONS, rtol=0.4)


def test_the_errors_are_those_that_repetition_shows() -> None:
    normal, diffuse = surface()
    rig = impasto.Rig(oracle.lights())
    clean = forward.stack(normal, diffuse, np.full(SHAPE, BETA), np.full(SHAPE, GAMMA), rig)
    rng = np.random.default_rng(5)
    logs, expected, pulls = [], [], []
    for _ in range(12):
        noise = 0.01 * np.sqrt(clean) * rng.standard_normal(clean.shape)
        fitted = impasto.fit_sbrdf(stack_of((clean + noise).astype(np.float32)), pooling="painting")
        logs.append([np.log(fitted.beta / BETA), np.log(fitted.gamma / GAMMA)])
        expected.append(np.diag(fitted.covariance))
        pulls.append(np.radians(tilt_error(fitted)) / fitted.sigma)
    # A deviation from 12 repetitions is uncertain by 1 / sqrt(22) = 21 %: three times that.
    ratio = np.sqrt(np.mean(np.square(logs), axis=0) / np.mean(expected, axis=0))
    assert ((ratio > 0.37) & (ratio < 1.64)).all(), ratio
    # sigma is that of the worst axis: with both alike the median of the length is 1.18 of it, with
    # one alone 0.67.
    assert 0.67 < np.median(pulls) < 1.3


# Circumstances that must not matter ------------------------------------------------------------

_SCRIPT = """
import sys, hashlib, numpy, impasto
samples = numpy.load(sys.argv[1])
lights = numpy.load(sys.argv[2])
fitted = impasto.fit_sbrdf(impasto.Stack(samples, lights=lights), threads=int(sys.argv[3]))
digest = hashlib.sha256()
for name in ("normal", "diffuse", "residual", "sigma", "misfit", "status"):
    digest.update(getattr(fitted, name).tobytes())
print(impasto._core.build_info()["simd"], digest.hexdigest(), fitted.beta.hex(), fitted.gamma.hex())
"""
_LEVEL = "import impasto; print(impasto._core.build_info()['simd'])"


def fingerprint(fitted: impasto.PooledSbrdf) -> tuple[bytes, ...]:
    maps = (fitted.normal, fitted.diffuse, fitted.residual, fitted.sigma, fitted.misfit)
    return (*(m.tobytes() for m in maps), fitted.status.tobytes(), fitted.covariance.tobytes())


@pytest.mark.slow
def test_threads_change_no_bit() -> None:
    # 9 tiles of 4096 pixels, the last one incomplete.
    samples = np.tile(photographs(), (1, 1, 7, 7))[:, :, :151, :223]
    one = impasto.fit_sbrdf(stack_of(samples), threads=1, pooling="painting")
    for threads in (2, 3, 5, 8):
        other = impasto.fit_sbrdf(stack_of(samples), threads=threads, pooling="painting")
        assert (one.beta, one.gamma) == (other.beta, other.gamma)
        assert fingerprint(one) == fingerprint(other)


@pytest.mark.slow
def test_instruction_sets_change_no_bit_of_the_default(tmp_path: Path) -> None:
    # Few pixels: the baseline's emulated multiply-add is slow.
    np.save(tmp_path / "samples.npy", photographs()[:, :, :9, :13])
    np.save(tmp_path / "lights.npy", oracle.lights())
    arguments = [str(tmp_path / "samples.npy"), str(tmp_path / "lights.npy"), "2"]
    answers: dict[str, list[str]] = {}
    for level in ("avx512", "avx2", "neon", "baseline"):
        # A level that this processor lacks is another one, and need not be tried twice.
        if run(_LEVEL, IMPASTO_SIMD=level).strip() not in answers:
            name, *answer = run(_SCRIPT, *arguments, IMPASTO_SIMD=level).split()
            answers[name] = answer
    assert "baseline" in answers, answers
    if len(answers) == 1:
        pytest.skip("this processor has no instruction set but the baseline")
    assert len({tuple(answer) for answer in answers.values()}) == 1, answers


def test_case_28_a_power_of_two_changes_no_shape(plain: impasto.PooledSbrdf) -> None:
    # 50: where photometric stereo, which all begins with, still keeps every bit.
    for power in (-50, -26, 7, 26, 50):
        scaled = impasto.fit_sbrdf(
            stack_of(photographs() * np.float32(2.0**power)), pooling="painting"
        )
        assert scaled.gamma == plain.gamma
        assert scaled.beta == plain.beta * 2.0**power
        assert scaled.normal.tobytes() == plain.normal.tobytes()
        assert scaled.sigma.tobytes() == plain.sigma.tobytes()
        assert scaled.misfit.tobytes() == plain.misfit.tobytes()
        np.testing.assert_array_equal(scaled.diffuse, plain.diffuse * np.float32(2.0**power))
        np.testing.assert_array_equal(scaled.residual, plain.residual * np.float32(2.0**power))
        np.testing.assert_array_equal(scaled.covariance, plain.covariance)
        np.testing.assert_array_equal(scaled.curve, plain.curve * (1.0, 2.0**power, 1.0))


def test_the_order_of_photographs_matters_little(plain: impasto.PooledSbrdf) -> None:
    order = np.random.default_rng(3).permutation(16)
    mixed = impasto.fit_sbrdf(
        stack_of(photographs()[order], oracle.lights()[order]), pooling="painting"
    )
    # Sums in another order: single precision, and where a search stops.
    assert mixed.beta == pytest.approx(plain.beta, rel=1e-4)
    assert np.median(np.abs(mixed.normal - plain.normal)) < 1e-5


def test_turning_everything_turns_the_normals(plain: impasto.PooledSbrdf) -> None:
    # A quarter turn about the viewing axis is exact in floating point.
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = impasto.fit_sbrdf(
        stack_of(photographs(), oracle.lights() @ turn.T), pooling="painting"
    )
    assert turned.beta == pytest.approx(plain.beta, rel=1e-4)
    expected = np.einsum("ij,jyx->iyx", turn, plain.normal)
    assert np.median(np.abs(turned.normal - expected)) < 1e-5


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float16", "float32"])
def test_every_sample_type_gives_the_same_surface(dtype: str, plain: impasto.PooledSbrdf) -> None:
    samples = np.clip(photographs(), 0.0, None)
    options: dict[str, Any] = {}
    if dtype.startswith("uint"):
        full = np.iinfo(dtype).max
        samples = np.minimum(np.rint(samples * full / 2.0), full - 1)
        options = {"scale": 2.0 / full}
    fitted = impasto.fit_sbrdf(stack_of(samples.astype(dtype), **options), pooling="painting")
    # 8 bits of a scale that reaches 2: steps of 0.008 against colours of 0.05; 16 bits and half
    # precision (11 bits, relative) are finer than the noise.
    loose = dtype == "uint8"
    assert fitted.beta == pytest.approx(plain.beta, rel=2e-2 if loose else 2e-3)
    assert fitted.gamma == pytest.approx(plain.gamma, rel=2e-2 if loose else 2e-3)
    assert np.median(tilt_error(fitted)) < (1.0 if loose else 0.15)


def test_near_lights_with_falloff() -> None:
    lights = [impasto.PointLight(tuple(300.0 * v)) for v in oracle.lights()]
    rig = impasto.Rig(lights, pitch_mm=5.0)
    fitted = impasto.fit_sbrdf(stack_of(photographs(lights=rig), rig), pooling="painting")
    assert fitted.beta == pytest.approx(BETA, rel=0.01)
    assert fitted.gamma == pytest.approx(GAMMA, rel=0.01)
    assert np.median(tilt_error(fitted)) < 0.15


# Hard cases ------------------------------------------------------------------------------------


def test_cases_1_2_20_26_27_bad_pixels_leave_the_others_alone(plain: impasto.PooledSbrdf) -> None:
    samples = photographs()
    samples[:, :, 0, 0] = 0.0  # black
    samples[:, :, 0, 5] = np.inf  # saturated everywhere
    samples[:, :, 1, 0] = np.nan  # never taken
    samples[1:, :, 1, 5] = np.nan  # one photograph only
    samples[:, :, 2, 0] = 0.3  # constant: no surface does that
    samples[3, 1, 2, 5] = -np.inf
    samples[4, 2, 3, 5] = np.nan
    fitted = impasto.fit_sbrdf(stack_of(samples), pooling="painting")
    check_maps(fitted)
    lost = {tuple(p) for p in np.argwhere(fitted.status >= 16).tolist()}
    assert lost == {(0, 0), (0, 5), (1, 0), (1, 5)}
    # The lobe is common property: without five of 768 pixels it moves by a small part of its
    # error, and every normal with it.
    assert fitted.beta == pytest.approx(plain.beta, rel=1e-3)
    assert np.median(np.abs(fitted.normal - plain.normal)[np.isfinite(fitted.normal)]) < 1e-4


def test_a_bad_pixel_changes_no_bit_of_its_neighbours_under_a_known_lobe() -> None:
    # A masked pixel and one that is NaN throughout both contribute nothing to the lobe.
    samples = photographs()
    mask = np.ones(SHAPE, bool)
    mask[5, 5] = False
    masked = impasto.fit_sbrdf(stack_of(samples, mask=mask), pooling="painting")
    samples[:, :, 5, 5] = np.nan
    missing = impasto.fit_sbrdf(stack_of(samples), pooling="painting")
    assert masked.beta == missing.beta
    assert fingerprint(masked)[:5] == fingerprint(missing)[:5]


def test_case_3_clipped_highlights_are_left_out() -> None:
    samples = photographs()
    level = np.float32(np.percentile(samples, 99.0))
    clipped = np.where(samples >= level, np.float32(level), samples)
    fitted = impasto.fit_sbrdf(stack_of(clipped, saturation=float(level)), pooling="painting")
    check_maps(fitted)
    # The tips of the highlights are gone; the flanks still tell, with twice the error.
    deviation = np.sqrt(np.diag(fitted.covariance))
    assert abs(np.log(fitted.gamma / GAMMA)) < 3 * deviation[1] + 2e-3
    assert abs(np.log(fitted.beta / BETA)) < 3 * deviation[0] + 5e-3


def test_case_4_no_highlight() -> None:
    fitted = impasto.fit_sbrdf(stack_of(photographs(beta=0.0)), pooling="painting")
    check_maps(fitted)
    assert fitted.verdict == "no-highlight"
    assert fitted.beta == 0.0
    assert np.isinf(np.diag(fitted.covariance)).all()
    assert np.isnan(fitted.describes)
    assert "no highlight" in repr(fitted)
    assert fitted.normal.tobytes() == fitted.normals.normal.tobytes()
    assert np.median(tilt_error(fitted)) < 0.3


def test_case_6_mirror_sharp() -> None:
    # 0.2 degrees: one pixel in a hundred has a highlight at all.
    fitted = impasto.fit_sbrdf(stack_of(photographs(beta=40.0, gamma=0.004)), pooling="painting")
    check_maps(fitted)
    assert np.median(tilt_error(fitted)) < 0.3
    if fitted.verdict == "fitted":
        assert fitted.gamma < 0.02


def test_case_7_flat() -> None:
    # 50 degrees wide: all but a part of the diffuse reflection.
    fitted = impasto.fit_sbrdf(stack_of(photographs(beta=1.0, gamma=0.9)), pooling="painting")
    check_maps(fitted)
    assert fitted.verdict in {"at-bound", "no-highlight", "fitted"}
    predicted = fitted.predict()
    # Whatever the names of the parts, the sum is that of the photographs.
    assert np.sqrt(np.mean((predicted - photographs(beta=1.0, gamma=0.9)) ** 2)) < 0.01


def test_case_24_shadows_are_left_out() -> None:
    samples = photographs()
    rng = np.random.default_rng(8)
    shadow = rng.random((16, 1, *SHAPE)) < 0.08
    fitted = impasto.fit_sbrdf(
        stack_of(np.where(shadow, samples * np.float32(0.05), samples)), pooling="painting"
    )
    check_maps(fitted)
    # One in twelve photographs of every pixel is wrong; the scale's breakdown is at one in four,
    # which 2 % of the pixels reach.
    assert fitted.beta == pytest.approx(BETA, rel=0.02)
    assert fitted.gamma == pytest.approx(GAMMA, rel=0.02)
    assert np.median(tilt_error(fitted)) < 0.2


def test_case_31_outliers() -> None:
    samples = photographs()
    rng = np.random.default_rng(9)
    struck = rng.random((16, 1, *SHAPE)) < 0.03
    fitted = impasto.fit_sbrdf(
        stack_of(np.where(struck, np.float32(50.0), samples)), pooling="painting"
    )
    check_maps(fitted)
    assert fitted.beta == pytest.approx(BETA, rel=0.02)
    assert fitted.gamma == pytest.approx(GAMMA, rel=0.02)


def test_case_21_the_same_photograph_twice(plain: impasto.PooledSbrdf) -> None:
    again = [*range(16), 0, 0, 0]
    fitted = impasto.fit_sbrdf(
        stack_of(photographs()[again], oracle.lights()[again]), pooling="painting"
    )
    check_maps(fitted)
    assert fitted.beta == pytest.approx(plain.beta, rel=5e-3)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_case_30_few_lights(count: int) -> None:
    picks = [0, 3, 6, 9, 12][:count]
    fitted = impasto.fit_sbrdf(
        stack_of(photographs()[picks], oracle.lights()[picks]), pooling="painting"
    )
    check_maps(fitted)
    assert fitted.beta >= 0.0


@pytest.mark.parametrize("lights", [[0], [0, 4], [0, 8, 4, 12]])
def test_cases_19_20_lights_that_determine_nothing(lights: list[int]) -> None:
    directions = oracle.lights()[lights]
    directions[:, 1] = 0.0
    stack = stack_of(photographs()[lights], directions)
    try:
        fitted = impasto.fit_sbrdf(stack, pooling="painting")
    except impasto.GeometryError as error:
        assert "light" in str(error)  # noqa: PT017
        return
    check_maps(fitted)
    assert (fitted.status >= 16).all()
    assert fitted.verdict == "too-few"


def test_case_22_grazing_lights_and_views() -> None:
    lights = np.vstack([oracle.lights(), [[0.999, 0.0, 0.04], [0.0, -0.999, 0.02]]])
    fitted = impasto.fit_sbrdf(stack_of(photographs(lights=lights), lights), pooling="painting")
    check_maps(fitted)
    assert fitted.beta == pytest.approx(BETA, rel=0.02)


def test_an_all_black_painting_has_no_surface() -> None:
    fitted = impasto.fit_sbrdf(stack_of(np.zeros((16, 3, *SHAPE), np.float32)), pooling="painting")
    check_maps(fitted)
    assert (fitted.status == Status.DARK).all()
    assert fitted.verdict == "too-few"


# What the lobe describes -----------------------------------------------------------------------


def test_one_varnish_is_described_and_three_are_not(plain: impasto.PooledSbrdf) -> None:
    assert plain.verdict == "fitted"
    assert plain.describes > 0.95
    assert plain.misfit.mean() < 0.02
    normal, diffuse = surface()
    third = np.arange(COLUMNS) // (COLUMNS // 3 + 1)
    beta = np.broadcast_to(np.array([2.0, 12.0, 30.0])[third], SHAPE)
    gamma = np.broadcast_to(np.array([0.3, 0.12, 0.075])[third], SHAPE)
    clean = forward.stack(normal, diffuse, beta, gamma, impasto.Rig(oracle.lights()))
    mixed = impasto.fit_sbrdf(stack_of(clean), pooling="painting")
    assert mixed.verdict == "mixed"
    assert mixed.describes < 0.7
    assert "only" in repr(mixed)
    # It is the lobe of one of them, and says where it is not.
    per_third = [float(np.mean(mixed.misfit[:, third == k])) for k in range(3)]
    assert min(per_third) < 0.1 < sorted(per_third)[1]


def test_extractions_start_from_different_samples_and_end_alike(plain: impasto.PooledSbrdf) -> None:
    stack = stack_of(photographs())
    starts = set()
    for extraction in ("residual", "maximum", "papers", "printed"):
        fitted = impasto.fit_sbrdf(stack, extraction=extraction)
        starts.add(tuple(fitted.path[0]))
        assert fitted.beta == pytest.approx(plain.beta, rel=1e-3)
    assert len(starts) == 4


def test_the_papers_procedure_keeps_the_normals_of_stereo() -> None:
    stack = stack_of(photographs())
    fitted = impasto.fit_sbrdf(stack, extraction="papers", joint=False)
    check_maps(fitted)
    assert len(fitted.path) == 1
    assert fitted.normal.tobytes() == fitted.normals.normal.tobytes()
    assert fitted.diffuse.tobytes() == fitted.normals.albedo.tobytes()


# Learn, then apply -----------------------------------------------------------------------------

POOLED: Any = {
    "extraction": "residual",
    "peak": False,
    "index": 1.45,
    "threads": 2,
    "progress": False,
}
MAPS = ("normal", "diffuse", "residual", "sigma", "misfit", "status")


def near_stack() -> impasto.Stack:
    """Near lights, so that a pixel's place matters; two pixels that nothing can be said of."""
    lights = [impasto.PointLight(tuple(300.0 * v)) for v in oracle.lights()]
    rig = impasto.Rig(lights, pitch_mm=5.0)
    samples = photographs(lights=rig)
    samples[:, :, 3, 4] = np.nan
    samples[:, :, 20, 30] = 0.0
    return stack_of(samples, rig)


def part_of(normals: impasto.Normals, rows: slice, columns: slice) -> impasto.Normals:
    """A tile of photometric stereo."""
    maps = {
        one.name: np.ascontiguousarray(value[..., rows, columns])
        for one in dataclasses.fields(normals)
        if isinstance(value := getattr(normals, one.name), np.ndarray) and value.ndim >= 2
    }
    return dataclasses.replace(normals, **maps)


@pytest.mark.parametrize("joint", [True, False])
def test_tiles_under_a_saved_lobe_have_the_bits_of_the_whole(tmp_path: Path, joint: bool) -> None:
    stack = near_stack()
    normals = impasto.fit_normals(stack)
    effort = Effort()
    whole = impasto.fit_sbrdf(stack, normals=normals, joint=joint)
    learned = learn_pooled(stack, normals, joint=joint, effort=effort, **POOLED)
    assert learned.refined == joint
    for name in ("beta", "gamma", "describes", "verdict", "converged"):
        assert getattr(learned, name) == getattr(whole, name), name
    for name in ("covariance", "curve", "path"):
        np.testing.assert_array_equal(getattr(learned, name), getattr(whole, name), name)
    np.savez(tmp_path / "learned.npz", **learned.arrays())
    with np.load(tmp_path / "learned.npz") as file:
        learned = LearnedLobe.from_arrays(file)
    for rows, columns in (
        (slice(0, ROWS), slice(0, COLUMNS)),
        (slice(0, 7), slice(0, 5)),
        (slice(3, 16), slice(11, 32)),
        (slice(19, 24), slice(29, 32)),
        (slice(23, 24), slice(0, 32)),
    ):
        height, width = rows.stop - rows.start, columns.stop - columns.start
        # The middle of the tile, in pixels right of and above the middle of the painting.
        right = columns.start + (width - COLUMNS) / 2
        up = (ROWS - height) / 2 - rows.start
        tile = stack_of(
            np.ascontiguousarray(np.asarray(stack.samples)[:, :, rows, columns]),
            impasto.Rig(stack.rig, origin=(right, up)),
        )
        stereo = part_of(normals, rows, columns)
        maps = PooledMaps.empty(3, (height, width))
        mapped = np.memmap(
            tmp_path / "diffuse.raw", dtype=np.float32, mode="w+", shape=maps.diffuse.shape
        )
        maps = dataclasses.replace(maps, diffuse=mapped)
        apply_pooled(learned, tile, stereo, maps=maps)
        for name in MAPS:
            expected = getattr(whole, name)[..., rows, columns]
            assert getattr(maps, name).tobytes() == expected.tobytes(), (name, rows, columns)


def test_a_lobe_is_learned_from_a_sample_of_the_pixels() -> None:
    stack = near_stack()
    normals = impasto.fit_normals(stack)
    mask = np.zeros(SHAPE, bool)
    mask[::2] = True
    masked = stack_of(np.asarray(stack.samples), stack.rig, mask=mask)
    sampled = np.where(mask, normals.status, Status.NOT_COMPUTED).astype(np.uint8)
    learned = learn_pooled(
        stack,
        dataclasses.replace(normals, status=sampled),
        joint=True,
        effort=Effort(),
        **POOLED,
    )
    of_mask = impasto.fit_sbrdf(masked, normals=normals, pooling="painting")
    # The reference brightness is that of the pixels whose colours are known, masked ones not.
    assert learned.beta == pytest.approx(of_mask.beta, rel=1.6e-4)
    maps = apply_pooled(learned, stack, normals)
    np.testing.assert_array_equal(maps.status >= 16, normals.status >= 16)


def test_maps_of_another_size_are_refused() -> None:
    stack = near_stack()
    normals = impasto.fit_normals(stack)
    learned = learn_pooled(stack, normals, joint=False, effort=Effort(), **POOLED)
    with pytest.raises(impasto.ArgumentError, match="normal: "):
        apply_pooled(learned, stack, normals, maps=PooledMaps.empty(3, (4, 4)))
