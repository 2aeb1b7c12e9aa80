"""Training spectra: what is packaged, and how well pigments are estimated that it does not have."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import impasto
from command_line import photographs
from impasto import ArgumentError, Training, simulate, systems, training
from impasto.cli import main
from study import pigments
from study.fits import reflectance

ROOT = Path(__file__).resolve().parents[1]


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "benches" / "python" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


benchmark, packaging = script("training_spectra"), script("training_centres")


def test_the_packaged_spectra_are_reflectances_with_their_attribution() -> None:
    spectra = training.pigments768()
    assert spectra.wavelengths.tolist() == list(range(400, 781, 10))
    assert 0.0 < spectra.reflectance.min() < 0.05
    assert 0.8 < spectra.reflectance.max() <= 1.0
    # No two are the same, and the wheel stays small.
    assert len(np.unique(spectra.reflectance, axis=0)) == 768
    assert training.PIGMENTS.stat().st_size < 100_000
    said = (training.PIGMENTS.parent / "ATTRIBUTION.md").read_text("utf-8")
    for part in (
        training.PIGMENTS.name,
        "Hilda Deborah",
        "https://doi.org/10.5281/zenodo.5592485",
        "https://creativecommons.org/licenses/by/4.0/",
        "Changes:",
    ):
        assert part in said
    project = (ROOT / "pyproject.toml").read_text("utf-8")
    assert "AND CC-BY-4.0" in project
    assert "python/impasto/data/ATTRIBUTION.md" in project


def test_the_packaged_spectra_come_from_their_script(data: Path) -> None:
    made = packaging.packaged(packaging.spectra_of(data)[0])
    with np.load(training.PIGMENTS) as file:
        np.testing.assert_array_equal(file["wavelengths"], made["wavelengths"])
        # Sums in another order may round to the next of 65535 steps.
        off = file["reflectance"].astype(int) - made["reflectance"].astype(int)
    assert np.abs(off).max() <= 1


def test_sets_add_up_with_their_names() -> None:
    grid = np.arange(400.0, 701.0, 100.0)
    one = Training(grid, np.full((2, 4), 0.5), "one", ["a", "b"])
    other = Training(grid[::3], np.array([[0.2, 0.8]]), "other", ["c"])
    both = one + other
    assert (both.name, both.names) == ("one + other", ("a", "b", "c"))
    np.testing.assert_allclose(both.reflectance[2], [0.2, 0.4, 0.6, 0.8])
    assert (one + Training(grid, np.ones((1, 4)))).names == ()
    with pytest.raises(ArgumentError, match="names: expected 2 or none, found 1"):
        Training(grid, np.ones((2, 4)), names=["a"])


@pytest.mark.parametrize("group", ["number", "family"])
def test_no_pigment_is_tested_and_learnt_from(group: str, data: Path) -> None:
    _, number = pigments.read_pigments(data)
    groups = number if group == "number" else benchmark.families(number)
    fold = benchmark.folds_of(groups)
    for each in range(benchmark.FOLDS):
        assert not set(groups[fold == each]) & set(groups[fold != each])
        # Groups have up to a few dozen spectra.
        assert abs((fold == each).mean() - 1 / benchmark.FOLDS) < 0.03


def test_a_centre_knows_nothing_of_held_out_pigments(data: Path) -> None:
    truth, number = pigments.read_pigments(data)
    test = benchmark.folds_of(number) == 0
    changed = truth.copy()
    changed[test] = 0.5
    default = f"and {packaging.COUNT} centres: default"
    count = benchmark.TRAININGS[default]
    found = [benchmark.learnt(spectra[~test], count) for spectra in (truth, changed)]
    np.testing.assert_array_equal(found[0].reflectance, found[1].reflectance)
    assert len(found[0]) == len(training.default_training())


def test_pigments_that_were_held_out_are_found(data: Path) -> None:
    """The default's recipe without the pigments that are tested: the goals of the project."""
    truth, number = pigments.read_pigments(data)
    camera = pigments.six_bands(data)
    default = f"and {packaging.COUNT} centres: default"
    by_number = benchmark.held_out(camera, truth, number, default, "ensemble")
    assert by_number["RMSE %"] < 0.7
    assert by_number["dE00"] < 0.6
    families = benchmark.families(number)
    by_family = benchmark.held_out(camera, truth, families, default, "ensemble")
    assert by_family["RMSE %"] < 0.8
    assert by_family["dE00"] < 0.6
    # What was the default: neither may the wider set cost anything.
    before = benchmark.held_out(camera, truth, families, benchmark.GENERAL, "root-polynomial")
    assert by_family["RMSE %"] < 0.8 * before["RMSE %"]
    assert by_family["dE00"] < 0.9 * before["dE00"]


@pytest.mark.parametrize("camera", pigments.CAMERAS)
def test_other_materials_do_not_lose(camera: str, data: Path) -> None:
    """Objects of all kinds, by the default and by what was the default before it."""
    made = pigments.CAMERAS[camera][0](data)
    truth, _ = pigments.read_pigments(data)
    centres = packaging.centres(truth)
    now = benchmark.on_other_materials(made, centres, "ensemble")
    before = benchmark.on_other_materials(made, centres[:0], "root-polynomial")
    assert now["RMSE %"] < before["RMSE %"]
    assert now["dE00"] < before["dE00"]


def test_wiener_on_held_out_pigments_is_its_formula(data: Path) -> None:
    """Eq. 5 of the six-band paper in float64, with the correlation of all other pigments."""
    truth, number = pigments.read_pigments(data)
    test = benchmark.folds_of(number) == 0
    camera = pigments.six_bands(data)
    photograph = pigments.photographed(camera, truth[test], np.random.default_rng(2))
    own = benchmark.learnt(truth[~test], None)
    fitted = reflectance(photograph, 1, estimator="wiener", training=own)
    response = camera.operator(pigments.GRID, integration="sum")
    correlation = own.reflectance.T @ own.reflectance / len(own)
    inner = response @ correlation @ response.T + pigments.NOISE**2 * np.eye(6)
    expected = photograph.responses[:, 0].T.astype(float) @ np.linalg.solve(
        inner, response @ correlation
    )
    found = pigments.spectra_of(fitted, int(test.sum()))
    # Single-precision input and output; entries of the operator reach 3.
    np.testing.assert_allclose(found, expected, atol=3e-6)


@pytest.mark.parametrize("camera", pigments.CAMERAS)
def test_the_ensemble_is_the_mean_of_two(camera: str, data: Path) -> None:
    photograph = pigments.pigment_data(camera, camera, data, 1, seed=1)
    one, two, both = (
        pigments.spectra_of(
            reflectance(photograph.stack, 1, estimator=name), len(photograph.spectra)
        )
        for name in ("root-polynomial", "radial-basis", "ensemble")
    )
    # Each drops coefficients that raise its root mean square error e (0.01 to 0.03) over the
    # training spectra by less than 1e-4: up to sqrt(2 e 1e-4) = 2.5e-3.
    assert np.sqrt(np.mean((both - (one + two) / 2) ** 2)) < 2.5e-3
    # The error of a mean is at most the mean of the errors.
    error = [np.sqrt(np.mean((found - photograph.spectra) ** 2)) for found in (one, two, both)]
    assert error[2] < (error[0] + error[1]) / 2


@pytest.mark.parametrize("name", ["tominaga-rgb-camera", "tominaga-six-band-adaptation"])
def test_the_systems_of_the_papers_learn_from_what_they_did(name: str) -> None:
    capture = simulate.default_capture(name, size=(16, 16))
    system = systems.get(name)
    _, spectra = system.measure(capture.stack, capture.truth.camera)
    assert spectra is not None
    assert spectra.info["training"] == "CES 99 + AMPAS 190"
    assert spectra.info["training_count"] == 289
    assert systems.get("impasto").training == "default"


def test_the_gloss_of_lobes_per_pixel_is_no_noise() -> None:
    """Every sample has gloss; noise is what a fit of the gloss leaves."""
    rng = np.random.default_rng(4)
    azimuth, height = np.arange(24) * 2.4, np.linspace(0.5, 0.95, 24)
    side = np.sqrt(1 - height**2)
    lights = np.stack([side * np.cos(azimuth), side * np.sin(azimuth), height], axis=1)
    rho, sigma = 0.4, 1e-3
    normal = np.zeros((3, 32, 32), np.float32)
    normal[2] = 1.0
    gloss = 0.05 * height**2
    clean = (height * rho + gloss)[:, None, None, None] * np.ones((24, 3, 32, 32))
    noise = sigma * rng.standard_normal(clean.shape)
    stack = impasto.Stack((clean + noise).astype(np.float32), lights=lights)
    # Of 72 samples, 2 + 3 + 1 + 3 numbers are fitted.
    residual = np.sqrt(np.mean(noise**2, axis=(0, 1)) * (72 - 9) / 72)
    source = {
        "diffuse": np.full((3, 32, 32), rho, np.float32),
        "normal": normal,
        "status": np.zeros((32, 32), np.uint8),
    }
    lobes = {"lobes": np.ones((32, 32), np.uint8), "residual": residual.astype(np.float32)}
    camera = simulate.camera("rgb")
    found = [
        impasto.fit_reflectance(stack, SimpleNamespace(**fields), camera).info["noise"]
        for fields in (source | lobes, source)
    ]
    # sqrt(n^T (L^T L)^-1 n) of these lights.
    expected = sigma * np.sqrt(np.linalg.inv(lights.T @ lights)[2, 2])
    # A root mean square of 72 numbers scatters by 8 %, its median over 1024 pixels by 0.4 %.
    assert found[0] == pytest.approx(expected, rel=0.02)
    assert found[1] > 10 * expected


@pytest.mark.parametrize("system", ["impasto", "tominaga-rgb-camera"])
def test_a_table_on_the_command_line_is_learnt_from_besides(tmp_path: Path, system: str) -> None:
    table, out = tmp_path / "palette.csv", tmp_path / "out"
    table.write_text("nm;ochre;smalt\n400;5,5;30\n550;20;21,5\n700;60;40\n", encoding="utf-8")
    words = f"fit {photographs(tmp_path)} --out {out} --quiet --system {system} --camera srgb"
    assert main([*words.split(), "--training", str(table)]) == 0
    info = impasto.Reflectance.load(out / "reflectance.npz").info
    own = training.default_training() if system == "impasto" else training.general_training()
    assert info["training"] == f"{own.name} + palette.csv"
    assert info["training_count"] == len(own) + 2
    report = json.loads((out / "report.json").read_text("utf-8"))
    assert report["options"]["training"] == str(table)
    assert str(table) in json.dumps(report["inputs"])
