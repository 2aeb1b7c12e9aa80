"""The study of reflectance estimators: pigments by camera, their errors, what is said of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest

import study
from impasto.colour import xyz_from_spectrum
from impasto.training import general_training
from study import data_sets, pigments, repeatability, settings, wiener_numpy
from study.sentences import paragraphs
from study.tables import tables

SIZES = data_sets.Sizes(painting=16, views=4, icon=16, paintings=1, pigments=1)
CAMERAS = tuple(pigments.CAMERAS)
RECORD = Path(__file__).resolve().parents[1] / "benches" / "results" / "study.json"


@pytest.fixture(scope="module")
def swept(data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Every estimator by every camera, each pigment once."""
    out = tmp_path_factory.mktemp("study")
    options: dict[str, Any] = {"knobs": ["reflectance"], "sizes": SIZES, "threads": 1}
    return out, study.run(out, data=data, repeats=1, **options)


def by_name(found: dict[str, Any]) -> dict[tuple[str, str], Any]:
    return {
        (row["data"].removeprefix(data_sets.OF_PIGMENTS), row["setting"]): row["error"]
        for row in found["rows"]
    }


def lab(spectra: Any) -> Any:
    """Under D65, by colour-science."""
    operator = xyz_from_spectrum(pigments.GRID, "D65")
    x, y, z = operator.sum(axis=1)
    white = np.array([x, y]) / (x + y + z)
    return colour.XYZ_to_Lab(np.maximum(spectra, 1e-4) @ operator.T, white)


@pytest.mark.parametrize("name", CAMERAS)
def test_errors_of_wiener_are_those_of_its_equation(
    name: str, data: Path, swept: tuple[Path, dict[str, Any]]
) -> None:
    """Eq. 5 of the six-band paper in a few lines, through the same responses."""
    plate = pigments.pigment_data("", name, data, 1, seed=0)
    grid = pigments.GRID * 1e-9
    light = grid**-5 / np.expm1(1.438776877e-2 / (grid * 3000.0))
    seen = plate.stack.camera.sensitivities * light
    seen /= seen.sum(axis=1, keepdims=True)
    training = general_training().at(pigments.GRID)
    inner = seen @ training.T @ training @ seen.T / len(training)
    inner += pigments.NOISE**2 * np.eye(len(seen))
    matrix = training.T @ training / len(training) @ seen.T @ np.linalg.inv(inner)
    rho = plate.stack.responses[:, 0].astype(np.float64)
    estimate, truth = (matrix @ rho).T, plate.spectra
    apart = colour.delta_E(lab(estimate), lab(truth), method="CIE 2000")
    rmse = np.sqrt(((estimate - truth) ** 2).mean(axis=1))
    error = by_name(swept[1])[name, "wiener"]
    # Applied in single precision: six products of at most 1, each rounded by 6e-8. Lightness rises
    # by 903 per unit of reflectance where it does so the most, next to black.
    assert error["colour"] == pytest.approx(apart.mean(), abs=903 * 6 * 6e-8)
    assert error["colour_p95"] == pytest.approx(np.percentile(apart, 95), abs=903 * 6 * 6e-8)
    assert error["spectrum"] == pytest.approx(rmse.mean(), abs=6 * 6e-8)
    # So is the peer.
    product = by_name(swept[1])[name, wiener_numpy.NAME]
    assert product["colour"] == pytest.approx(error["colour"], abs=903 * 6 * 6e-8)


def test_every_camera_has_every_estimator(swept: tuple[Path, dict[str, Any]]) -> None:
    found = swept[1]
    error = by_name(found)
    assert error.keys() == {
        (name, estimator)
        for name in CAMERAS
        for estimator in (*settings.ESTIMATORS, wiener_numpy.NAME)
    }  # fmt: skip
    assert not found["failed"]
    for name in CAMERAS:
        off = {estimator: error[name, estimator] for estimator in settings.ESTIMATORS}
        best, worst = "root-polynomial", "linear-model"
        assert min(off, key=lambda e: off[e]["colour"]) == best
        assert max(off, key=lambda e: off[e]["colour"]) == worst
        assert all(e["colour"] < e["colour_p95"] for e in off.values())
        assert all(0 < e["spectrum"] < e["spectrum_p95"] for e in off.values())
    # Six bands see more than three.
    for estimator in settings.ESTIMATORS:
        assert error["6BP", estimator]["spectrum"] < 0.5 * error["RGB", estimator]["spectrum"]


def test_a_large_picture_of_pigments_is_a_small_one_over_and_over(data: Path) -> None:
    small = pigments.pigment_data("small", "6BP", data, 1, seed=3)
    count = len(small.spectra)
    assert (count, small.megapixels) == (1586, pytest.approx(0.001586))
    large = pigments.pigment_data("large", "6BP", data, count + 1, seed=3)
    assert large.megapixels == 2 * small.megapixels
    assert (large.stack.responses[:, :, count:] == small.stack.responses).all()
    # Errors are of the pigments, in a picture of any size the same bits.
    (setting,) = (s for s in settings.settings() if s.name == "radial-basis")
    first, second = (setting.judge([setting.fit(p.stack, 1)], (p,)) for p in (small, large))
    assert first == second


def test_cameras_without_their_files_are_missing(tmp_path: Path) -> None:
    (tmp_path / "spectra").mkdir()
    names = [f"pigments, {camera}" for camera in CAMERAS]
    made, missing = data_sets.available(SIZES, 0, tmp_path)
    assert not set(names) & made.keys()
    both = "spectra/hyppigments.npz, spectra/cameras.npz are not at hand"
    assert missing["pigments, RGB"] == f"{both} (they are not part of impasto)"
    (tmp_path / pigments.PIGMENTS).touch()
    made, missing = data_sets.available(SIZES, 0, tmp_path)
    # Bandpass filters are a formula.
    assert set(names) & made.keys() == {"pigments, 6BP"}
    assert "spectra/cameras.npz is not at hand" in missing["pigments, RGB"]
    assert "spectra/cameras.npz, spectra/filters.npz are" in missing["pigments, RGB+2"]
    before = data_sets.digests(tmp_path)
    assert list(before) == ["pigments, 6BP"]
    (tmp_path / pigments.PIGMENTS).write_bytes(b"other pigments")
    assert data_sets.digests(tmp_path) != before


def test_the_quick_study_takes_some_of_it() -> None:
    quick = [s.name for s in settings.settings(quick=True) if s.knob == "reflectance"]
    assert quick == ["wiener", "root-polynomial", wiener_numpy.NAME]


def test_estimators_are_written_and_drawn(swept: tuple[Path, dict[str, Any]]) -> None:
    out, found = swept
    drawn = {path.name for path in study.write(found, out)}
    assert drawn == {"study.json", "study.md", "reflectance.svg", "reflectance.png"}
    page = (out / "study.md").read_text("utf-8")
    assert "## Reflectance of measured pigments" in page
    assert 'Against `"wiener"`: ' in page
    assert page.count("| pigments, six bandpass filters |") == 5
    figure = (out / "reflectance.svg").read_text("utf-8")
    for name in settings.ESTIMATORS:
        assert figure.count(f">{name}<") == len(CAMERAS)
    # A second run that finds the same agrees.
    rows = repeatability.beside(found, found)
    assert repeatability.kept(rows)
    rows[0]["again"]["same"] = False
    assert not repeatability.kept(rows)


def pigment_rows(data: str) -> list[dict[str, Any]]:
    """By hand, a camera's: microseconds, ΔE00, share of white."""
    return [
        {
            "knob": "reflectance", "setting": name, "data": data, "number": None,
            "options": {} if name == wiener_numpy.NAME else {"estimator": name},
            "cost": {"cpu": seconds, "wall": seconds}, "doubt": 0.01, "timings": 6,
            "error": {
                "colour": off, "colour_p95": 2 * off, "spectrum": share, "spectrum_p95": 2 * share,
                "fitness": 0.99,
            },
        }
        for name, seconds, off, share in (
            ("wiener", 0.01, 2.0, 0.03),
            ("root-polynomial", 0.02, 1.5, 0.026),
            (wiener_numpy.NAME, 0.005, 2.0, 0.03),
        )
    ]  # fmt: skip


def test_a_sentence_says_what_an_estimator_is_worth() -> None:
    rows = [row for name in CAMERAS for row in pigment_rows(f"pigments, {name}")]
    for row in rows[3:6]:
        row["error"] = row["error"] | {"colour": row["error"]["colour"] / 2}
    assert paragraphs(rows)["reflectance"] == (
        'Against `"wiener"`: `"root-polynomial"` 2.0 times the time, colours -0.50 to -0.25 ΔE00, '
        "spectra -0.40 % of white. The same estimate by one matrix product of numpy takes 0.5 "
        "times the time; mean colour differences agree to 0 ΔE00."
    )
    assert "reflectance" not in paragraphs(rows[:1])
    first, *_ = tables(rows)["reflectance"]
    assert first == {
        "data": "pigments, RGB camera", "setting": wiener_numpy.NAME, "CPU ns": 5.0, "wall ns": 5.0,
        "dE00": 2.0, "dE00 p95": 4.0, "RMSE %": 3.0,
    }  # fmt: skip


def test_pigments_change_nothing_that_is_said_of_paintings() -> None:
    recorded = json.loads(RECORD.read_text("utf-8"))["rows"]
    paintings = [row for row in recorded if row["knob"] != "reflectance"]
    rows = paintings + pigment_rows("pigments, 6BP")
    before, after = tables(paintings), tables(rows)
    assert list(after.keys() - before.keys()) == ["reflectance"]
    assert {name: after[name] for name in before} == before
    said = paragraphs(rows)
    assert said.pop("reflectance")
    assert said == paragraphs(paintings)
