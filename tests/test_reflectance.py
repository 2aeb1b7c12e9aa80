"""Reflectance: estimators against independent numbers, homogeneity, hard cases, statuses."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from impasto import (
    ArgumentError,
    Camera,
    CorruptInputError,
    DistantLight,
    Reflectance,
    Stack,
    Status,
    Training,
    _core,
    fit_reflectance,
    white_corrected,
)
from impasto.training import ampas190, ces99, default_training, general_training, pigments768


def _oracle():
    path = Path(__file__).parent / "oracles" / "spectral_estimators.py"
    spec = importlib.util.spec_from_file_location("spectral_estimators", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


oracle = _oracle()
GRID = np.arange(400.0, 701.0, 10.0)
NAMES = ["wiener", "linear-model", "root-polynomial", "radial-basis", "ensemble"]


def gaussians(centres, width):
    return np.exp2(-4 * ((GRID - np.asarray(centres)[:, None]) / width) ** 2)


CAMERAS = {
    "rgb": Camera(GRID, gaussians([450, 540, 610], 80), "D65"),
    "six": Camera(GRID, gaussians(np.arange(425, 676, 50), 50), 3000.0),
}


@pytest.fixture(scope="module")
def spectra():
    return np.ascontiguousarray(default_training().at(GRID))


def estimator(name, camera, training, noise=1e-3, rank=None):
    return _core.spectral_estimator(
        name, np.ascontiguousarray(camera.operator(GRID)), training, noise, rank, 1
    )


def applied(built, responses, status=None, threads=1):
    """Coefficients and statuses of responses ``(band, y, x)``; what is passed over shows."""
    shape = responses.shape[1:]
    rank = built.basis.shape[1]
    maps = SimpleNamespace(
        coefficients=np.full((rank, *shape), 77.0, np.float32), status=np.full(shape, 99, np.uint8)
    )
    built.apply(responses, status, maps, threads, None)
    return maps.coefficients, maps.status


def matrix(built, bands):
    """The linear map ``(n, band)`` of a linear estimator."""
    return built.basis @ built.evaluate(np.eye(bands)).T


def test_the_wheel_holds_the_default_training_set():
    assert (len(ces99()), len(ampas190()), len(general_training())) == (99, 190, 289)
    assert (len(pigments768()), len(default_training())) == (768, 289 + 768)
    assert default_training().wavelengths[[0, -1]].tolist() == [380.0, 780.0]


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2])
def test_wiener_is_equation_5(camera, noise, spectra):
    response = CAMERAS[camera].operator(GRID)
    found = matrix(estimator("wiener", CAMERAS[camera], spectra, noise), len(response))
    expected = oracle.wiener(spectra, response, noise)
    # Two backward-stable paths differ by eps times the condition of H R H^T (2e3 here), and 1e-12
    # is twice that.
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()


def test_wiener_keeps_nine_digits_up_to_a_condition_of_1e7(spectra):
    # Bands that nearly repeat: condition of H R H^T around 1e6.
    curves = gaussians([450, 540, 610, 460, 550, 600], 90)
    camera = Camera(GRID, curves, "A")
    built = estimator("wiener", camera, spectra, 0.0)
    assert 1e5 < built.diagnostics["condition"] < 1e7
    expected = oracle.wiener_by_least_squares(spectra, camera.operator(GRID), 0.0)
    assert np.abs(matrix(built, 6) - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(("camera", "terms"), [("rgb", 3), ("six", 6), ("six", 3)])
def test_the_linear_model_is_equations_4_to_7(camera, terms, spectra):
    response = CAMERAS[camera].operator(GRID)
    built = estimator("linear-model", CAMERAS[camera], spectra, rank=terms)
    expected = oracle.linear_model(spectra, response, terms)
    assert built.basis.shape == (31, terms)
    # The components come from eigenvectors here and singular vectors there: their angle errors,
    # eps |R| / gap, stay below 1e-12 for the gaps of the first six; H B has condition 30.
    assert np.abs(matrix(built, len(response)) - expected).max() <= 1e-10 * np.abs(expected).max()


def test_the_linear_model_reproduces_the_responses(spectra):
    """What makes it the paper's model: H S = rho exactly, for any rho."""
    camera = CAMERAS["rgb"]
    built = matrix(estimator("linear-model", camera, spectra), 3)
    np.testing.assert_allclose(camera.operator(GRID) @ built, np.eye(3), atol=1e-12)


def test_the_root_polynomial_minimises_its_ridge_error(spectra):
    """The gradient of the training error at the solution is the ridge's pull (noise 0: no draw)."""
    camera = CAMERAS["rgb"]
    built = estimator("root-polynomial", camera, spectra, noise=0.0, rank=31)
    features = oracle.root_polynomial_features(spectra @ camera.operator(GRID).T)
    ridge = built.diagnostics["ridge"]
    gram = features.T @ features / len(features) + ridge * np.eye(features.shape[1])
    expected = features @ np.linalg.solve(gram, features.T @ spectra / len(features))
    found = built.evaluate(spectra @ camera.operator(GRID).T) @ built.basis.T
    # Condition of the ridged normal equations: 0.3 / 1e-9 at most, times eps.
    assert np.abs(found - expected).max() <= 1e-6


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("camera", CAMERAS)
def test_estimates_scale_with_the_light(name, camera, spectra):
    """Homogeneity of degree one: f(a rho) = a f(rho)."""
    rho = spectra @ CAMERAS[camera].operator(GRID).T
    built = estimator(name, CAMERAS[camera], spectra)
    reference = built.evaluate(np.ascontiguousarray(rho))
    size = np.linalg.norm(reference, axis=1, keepdims=True)
    for scale in (0.05, 0.3, 1.7, 4.0):
        scaled = built.evaluate(np.ascontiguousarray(scale * rho)) / scale
        assert (np.abs(scaled - reference) / size).max() <= 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_single_precision_follows_double(name, spectra):
    rho = spectra @ CAMERAS["six"].operator(GRID).T
    built = estimator(name, CAMERAS["six"], spectra)
    single = np.ascontiguousarray(rho.T[:, None], dtype=np.float32)
    coefficients, status = applied(built, single)
    reference = built.evaluate(np.ascontiguousarray(single[:, 0].T.astype(np.float64)))
    assert (status == Status.FITTED).all()
    # Each of the products is rounded to 6e-8 of itself; weights of the Gaussians reach hundreds.
    limit = 1e-4 if name in {"radial-basis", "ensemble"} else 1e-5
    assert np.abs(coefficients[:, 0].T - reference).max() <= limit


@pytest.mark.parametrize("name", NAMES)
def test_the_basis_is_orthonormal_and_the_strongest_comes_first(name, spectra):
    built = estimator(name, CAMERAS["six"], spectra)
    np.testing.assert_allclose(
        built.basis.T @ built.basis, np.eye(built.basis.shape[1]), atol=1e-12
    )
    power = np.square(built.evaluate(spectra @ CAMERAS["six"].operator(GRID).T)).sum(axis=0)
    assert power[0] == power.max()
    assert built.diagnostics["truncation"] <= 1e-4


HARD = {
    "duplicate bands": gaussians([450, 550, 650, 450, 550, 650], 66),
    "collinear bands": (lambda a: np.vstack([a, a + 1e-6 * (np.roll(a, -1, axis=0) - a)]))(
        gaussians([450, 550, 650], 66)
    ),
    "one band": gaussians([550], 66),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("case", HARD)
@pytest.mark.parametrize("noise", [0.0, 1e-8, 1e-3])
def test_degenerate_cameras_give_finite_estimates(name, case, noise, spectra):
    camera = Camera(GRID, HARD[case], 3000.0)
    built = estimator(name, camera, spectra, noise)
    clean = spectra @ camera.operator(GRID).T
    rng = np.random.default_rng(0)
    rho = np.ascontiguousarray(clean + 5e-3 * rng.standard_normal(clean.shape))
    error = np.sqrt(np.mean((built.evaluate(rho) @ built.basis.T - spectra) ** 2))
    # Three bands with exact inverse see these spectra with 0.05; an operator that divides by
    # rounding errs by 0.1 to 1e4. One band knows the brightness only.
    assert error < (0.2 if case == "one band" else 0.08)


def picture(pixels):
    """Responses ``(band, 1, pixels)``."""
    return np.ascontiguousarray(np.asarray(pixels, dtype=np.float32).T[:, None])


@pytest.mark.parametrize("name", NAMES)
def test_every_bad_pixel_has_a_status(name):
    nan, inf = np.nan, np.inf
    rho = picture([
        [0.4, 0.5, 0.3], [0.4, nan, 0.3], [0.4, 0.5, inf], [nan, nan, nan], [inf, nan, inf],
        [0.0, 0.0, 0.0], [-0.01, 0.2, 0.0], [1e-38, 1e-38, 1e-38], [3e38, -3e38, 3e38],
    ])  # fmt: skip
    fit = fit_reflectance(None, rho, CAMERAS["rgb"], estimator=name)
    estimated = fit.status[0] < 16
    assert [Status(s).name for s in fit.status[0, :8]] == [
        "FITTED", "ILL_CONDITIONED", "ILL_CONDITIONED", "INVALID_INPUT", "SATURATED",
        "FITTED", "FITTED", "FITTED",
    ]  # fmt: skip
    assert (np.isfinite(fit.coefficients[:, 0]).all(axis=0) == estimated).all()
    assert (np.isnan(fit.coefficients[:, 0, ~estimated])).all()
    assert not fit.coefficients[:, 0, 5].any(), "black stays black"


def test_the_statuses_of_the_source_are_kept():
    codes = [Status.FITTED, Status.RELAXED, Status.DARK, Status.MASKED]
    rho = picture([[0.4, 0.5, 0.3], [0.4, 0.5, 0.3], [0.0, 0.0, 0.0], [np.nan] * 3])
    source = SimpleNamespace(albedo=rho, status=np.array([codes], dtype=np.uint8))
    fit = fit_reflectance(None, source, CAMERAS["rgb"])
    assert fit.status[0].tolist() == [int(code) for code in codes]
    assert not fit.coefficients[:, 0, 2].any()
    assert np.isnan(fit.coefficients[:, 0, 3]).all()


def test_a_missing_band_is_the_operator_of_the_others(spectra):
    """Wiener without band 2 is eq. 5 with that row of H left out."""
    camera = CAMERAS["six"]
    rho = camera.response(spectra, GRID)[:5]
    rho[:, 2] = np.nan
    kept = [0, 1, 3, 4, 5]
    fit = fit_reflectance(
        None, picture(rho), camera,
        estimator="wiener", training=spectra, wavelengths=GRID, noise=1e-3,
    )  # fmt: skip
    expected = rho[:, kept] @ oracle.wiener(spectra, camera.operator(GRID)[kept], 1e-3).T
    found = np.array([fit.spectrum(0, x) for x in range(5)])
    for y, x in ((0, fit.status.shape[1]), (1.5, 0)):
        with pytest.raises(ArgumentError, match=r"^[xy]: "):
            fit.spectrum(y, x)
    # Single-precision input and output.
    np.testing.assert_allclose(found, expected, atol=2e-6)


@pytest.mark.parametrize("name", NAMES)
def test_tiles_threads_and_neighbours_change_no_bit(name, spectra):
    rng = np.random.default_rng(3)
    rho = CAMERAS["six"].response(spectra[rng.integers(0, 289, 9001)], GRID)
    rho[rng.random(rho.shape) < 0.01] = np.nan
    built = estimator(name, CAMERAS["six"], spectra)
    whole = applied(built, picture(rho))
    threaded = applied(built, picture(rho), threads=3)
    pieces = [applied(built, picture(rho[i : i + 37])) for i in range(0, 370, 37)]
    for kind in (0, 1):
        np.testing.assert_array_equal(threaded[kind], whole[kind])
        part = np.concatenate([piece[kind] for piece in pieces], axis=-1)
        np.testing.assert_array_equal(part, whole[kind][..., :370])


@pytest.mark.parametrize("name", NAMES)
def test_statuses_are_followed_pixel_by_pixel(name, spectra):
    """Beyond the first tile, in panels with exceptions and in one tile without any."""
    rng = np.random.default_rng(4)
    rho = CAMERAS["six"].response(spectra[rng.integers(0, 289, 9001)], GRID)
    codes = [Status.FITTED, Status.ILL_CONDITIONED, Status.DARK, Status.SATURATED]
    before = rng.choice(codes, 9001, p=[0.5, 0.48, 0.01, 0.01]).astype(np.uint8)
    holes = rng.random(9001) < 0.01
    calm = np.s_[4096:8192]
    before[calm], holes[calm] = Status.ILL_CONDITIONED, False
    built = estimator(name, CAMERAS["six"], spectra)
    sound, _ = applied(built, picture(rho))
    rho[holes, 2] = np.nan
    found, status = applied(built, picture(rho), status=before[None])
    estimated = before < 16
    expected = np.where(holes & estimated, Status.ILL_CONDITIONED, before)
    np.testing.assert_array_equal(status[0], expected)
    whole = estimated & ~holes
    np.testing.assert_array_equal(found[:, 0, whole], sound[:, 0, whole])
    assert np.isfinite(found[:, 0, holes & estimated]).all()
    assert not found[:, 0, before == Status.DARK].any()
    assert np.isnan(found[:, 0, before == Status.SATURATED]).all()
    for some in (whole[calm], holes & estimated, before == Status.DARK, holes & ~estimated):
        assert some.any()


def test_equation_8_on_the_responses_corrects_the_spectrum(spectra):
    """A slanted patch under a slanted light reads like the frontal one after correction."""
    camera = CAMERAS["rgb"]
    rho = camera.response(spectra[:4], GRID).T[:, None]
    cosine, cos_white, board = np.array([[0.9, 0.5, 0.2, -0.1]]), 0.7, 0.8
    photograph = 1.3 * rho * np.maximum(cosine, 0)
    corrected = white_corrected(photograph, cosine, 1.3 * board * cos_white / board, cos_white)
    np.testing.assert_allclose(corrected[..., :3], rho[..., :3], rtol=1e-6)
    fit = fit_reflectance(None, corrected, camera, estimator="linear-model", wavelengths=GRID)
    flat = fit_reflectance(None, rho, camera, estimator="linear-model", wavelengths=GRID)
    # Eq. 8 as printed, on the spectrum.
    for x in range(3):
        np.testing.assert_allclose(fit.spectrum(0, x), flat.spectrum(0, x), atol=2e-6)
    assert fit.status[0, 3] == Status.INVALID_INPUT


def test_noise_is_measured_on_the_stack():
    """Oracle: the variance of a least-squares fit, from many draws of the noise."""
    rng = np.random.default_rng(5)
    azimuth = np.arange(16) * np.pi / 8
    lights = np.stack([0.7 * np.cos(azimuth), 0.7 * np.sin(azimuth), np.full(16, 0.714)], axis=1)
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    rho = rng.uniform(0.2, 0.8, (3, 64, 64))
    sigma = 4e-3
    clean = lights[:, 2, None, None, None] * rho
    samples = (clean + sigma * rng.standard_normal(clean.shape)).astype(np.float32)
    fitted = np.einsum("io,obyx->ibyx", np.linalg.pinv(lights), samples)
    normal = np.zeros((3, 64, 64), np.float32)
    normal[2] = 1
    source = SimpleNamespace(
        albedo=fitted[2].astype(np.float32), normal=normal, status=np.zeros((64, 64), np.uint8)
    )
    stack = Stack(samples, lights=[DistantLight(tuple(light)) for light in lights])
    fit = fit_reflectance(stack, source, CAMERAS["rgb"])
    truth = np.std(fitted[2] - rho)
    assert fit.info["noise_from"] == "stack"
    # The median of 200 000 absolute values is within 1 %; one unknown per band was fitted here and
    # not three, which the correction for the degrees of freedom overstates by 7 %.
    assert fit.info["noise"] == pytest.approx(truth, rel=0.1)


def test_a_reflectance_survives_its_file(tmp_path):
    fit = fit_reflectance(None, picture([[0.4, 0.5, 0.3], [np.nan] * 3]), CAMERAS["rgb"])
    fit.save(tmp_path / "paint.npz")
    again = Reflectance.load(tmp_path / "paint.npz")
    for name in ("coefficients", "basis", "wavelengths", "status"):
        np.testing.assert_array_equal(getattr(again, name), getattr(fit, name))
    assert again.info == fit.info
    assert [path.name for path in tmp_path.iterdir()] == ["paint.npz"]
    (tmp_path / "paint.npz").write_bytes((tmp_path / "paint.npz").read_bytes()[:300])
    with pytest.raises(CorruptInputError, match=r"paint\.npz"):
        Reflectance.load(tmp_path / "paint.npz")


def test_a_cube_is_made_only_when_asked():
    fit = fit_reflectance(None, picture([[0.9, 1.2, 1.3]]), CAMERAS["rgb"])
    assert fit.basis.shape == (len(fit.coefficients), 61)
    np.testing.assert_allclose(fit.cube()[:, 0, 0], fit.spectrum(0, 0), atol=1e-6)
    assert fit.cube().max() > 1
    assert fit.cube(clip=(0, 1)).max() == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"diffuse": np.ones((2, 1, 1))}, r"diffuse: expected \(3, y, x\).*red, green, blue"),
        ({"diffuse": np.ones((3, 4))}, "diffuse: expected"),
        ({"estimator": "magic"}, "estimator: expected 'ensemble' or 'root-polynomial'"),
        ({"estimator": "weiner"}, "estimator: .*did you mean 'wiener'"),
        ({"training": np.ones((5, 7))}, r"training: expected shape \(spectrum, 61\)"),
        ({"training": np.full((5, 61), np.nan)}, "training: .*nan in spectrum 0 at 400 nm"),
        ({"training": np.ones((3, 61))}, "training: a regression needs at least 5"),
        ({"training": np.zeros((9, 61))}, "training: all numbers are 0"),
        ({"noise": -1.0}, "noise: expected at least 0"),
        ({"rank": 0}, "rank: expected a positive integer"),
        ({"rank": "x"}, "rank: expected a positive integer or None, found 'x'"),
        ({"wavelengths": [500.0, 400.0]}, "wavelengths: .*increasing"),
    ],
)
def test_wrong_arguments_are_refused_in_words(change, words):
    arguments = {"diffuse": np.ones((3, 1, 1)), "camera": CAMERAS["rgb"]} | change
    with pytest.raises(ArgumentError, match=words):
        fit_reflectance(None, **arguments)


def test_training_comes_as_a_set_a_pair_or_an_array():
    rho = picture([[0.4, 0.5, 0.3]])
    wavelengths = np.arange(400.0, 701.0, 5.0)
    values = default_training().at(wavelengths)
    fits = [
        fit_reflectance(None, rho, CAMERAS["rgb"], training=training)
        for training in (Training(wavelengths, values), (wavelengths, values), values, None)
    ]
    for fit in fits[1:]:
        np.testing.assert_allclose(fit.spectrum(0, 0), fits[0].spectrum(0, 0), atol=1e-6)
    assert [fit.info["training"] for fit in fits] == ["user"] * 3 + [default_training().name]


def test_the_bands_of_stack_and_camera_in_different_orders():
    curves = gaussians([450, 540, 610], 80)
    source = SimpleNamespace(
        diffuse=picture([[0.4, 0.5, 0.3]]),
        status=np.zeros((1, 1), np.uint8),
        bands=("blue", "green", "red"),
    )
    with pytest.raises(ArgumentError, match=r"camera: .*another order \(blue, green, red\)"):
        fit_reflectance(None, source, Camera(GRID, curves, "D65"))
    fit_reflectance(None, source, Camera(GRID, curves, "D65", bands=source.bands))
    # Other names say nothing about the order.
    fit_reflectance(None, source, Camera(GRID, curves, "D65", bands=["610", "540", "450"]))
