"""The papers' systems, by name: what they do, how near they come, and how they are asked for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import impasto
from impasto import simulate, systems
from impasto.cli import main
from impasto.figures import figures, specular_component
from impasto.fit.average import with_mean_albedo

SIZE = (64, 64)
PAPERS = ("tominaga-rgb-camera", "tominaga-six-band-adaptation")

Measured = tuple[simulate.Capture, impasto.PooledSbrdf, impasto.Reflectance]


@pytest.fixture(scope="module", params=PAPERS)
def measured(request: pytest.FixtureRequest) -> Measured:
    capture = simulate.default_capture(request.param, size=SIZE)
    system = systems.get(request.param)
    return capture, *system.measure(capture.stack, capture.truth.camera)


def test_a_system_comes_near_the_truth(measured: Measured) -> None:
    capture, sbrdf, reflectance = measured
    score = simulate.score(capture.truth, sbrdf, reflectance)
    rgb = capture.stack.shape[1] == 3
    # Twice what benches/python/systems.py records for nine times as many pixels: a smaller
    # painting has other brushwork.
    assert score.estimated == 1.0
    assert score.normal_mean < (5.5 if rgb else 2.5)
    assert score.colour_mean["D65"] < (5.0 if rgb else 1.5)
    assert score.reflectance_rmse < (0.06 if rgb else 0.02)
    assert abs(score.beta) < 0.25
    assert abs(score.gamma) < 0.15


def test_a_system_does_what_its_paper_says(measured: Measured) -> None:
    capture, sbrdf, reflectance = measured
    stack = capture.stack
    rgb = stack.shape[1] == 3
    rule = (
        {"method": "threshold", "w1": 1.2, "w2": 0.1, "selection": "green"}
        if rgb
        else {"method": "rank", "low": 0.1, "high": 0.5}
    )
    stereo = impasto.fit_normals(stack, **rule)
    np.testing.assert_array_equal(sbrdf.normal, stereo.normal)
    if rgb:
        # Section 4.2, against float64 numpy in tests/test_papers.py.
        stereo = with_mean_albedo(stack, stereo, w1=1.2, w2=0.1)
    np.testing.assert_array_equal(sbrdf.diffuse, stereo.albedo)
    assert len(sbrdf.path) == 1, "the papers stop at the separate fit"
    apart = impasto.fit_sbrdf(stack, normals=stereo, extraction="printed", peak=rgb, joint=False)
    assert (sbrdf.beta, sbrdf.gamma) == (apart.beta, apart.gamma)
    assert reflectance.info["estimator"] == ("linear-model" if rgb else "wiener")
    assert len(reflectance.basis) == (3 if rgb else 6)


def test_the_pictures_are_those_of_the_papers(measured: Measured) -> None:
    capture, sbrdf, reflectance = measured
    rgb = capture.stack.shape[1] == 3
    pictures = systems.get(PAPERS[0] if rgb else PAPERS[1]).render(sbrdf, reflectance)
    above = [impasto.DistantLight((0.0, 0.71, 0.71))]
    if rgb:
        assert list(pictures) == ["figure-12"]
        scenes = {"figure-12": impasto.Scene(above, illuminant="D65")}
    else:
        assert list(pictures) == [
            f"figure-{number}-{side}" for number in (8, 9) for side in ("front", "slanted")
        ]
        scenes = {
            "figure-8-front": impasto.Scene(above, illuminant="A", exposure="maximum"),
            "figure-9-slanted": impasto.Scene(
                above, illuminant="A", adaptation=0.56, exposure="maximum", view=(0.64, 0.0, 0.77)
            ),
        }
        for image in pictures.values():
            # "The data transformation for Y_W = Y_max": white of the display has Y = 1.
            highest = image.exposure * image.xyz[1][image.coverage > 0].max()
            assert highest == pytest.approx(1.0, rel=1e-6)
    for name, scene in scenes.items():
        expected = impasto.render(sbrdf, scene, reflectance=reflectance)
        np.testing.assert_array_equal(pictures[name].display, expected.display)


def test_the_other_figures_show_the_maps(measured: Measured) -> None:
    capture, sbrdf, reflectance = measured
    rgb = capture.stack.shape[1] == 3
    system = systems.get(PAPERS[0] if rgb else PAPERS[1])
    drawn = figures(system, capture.stack, sbrdf, reflectance, truth=capture.truth)
    numbers = (8, 9, 10, 11) if rgb else (2, 5, 6)
    assert sorted(drawn) == sorted(f"figure-{number}" for number in numbers)
    for picture in drawn.values():
        assert picture.dtype == np.uint8
        assert picture.std() > 5
    if rgb:
        expected = np.rint((sbrdf.normal + 1.0) / 2.0 * 255.0)
        np.testing.assert_array_equal(np.moveaxis(drawn["figure-8"], -1, 0), expected)
    # Without the truth of a simulation there is one line fewer.
    alone = figures(system, capture.stack, sbrdf, reflectance)
    spectra = "figure-10" if rgb else "figure-6"
    amber = (drawn[spectra] == (232, 161, 90)).all(axis=-1)
    assert amber.sum() > 100
    assert not (alone[spectra] == (232, 161, 90)).all(axis=-1).any()


def test_the_specular_component_is_the_maximum_less_the_diffuse_part(measured: Measured) -> None:
    capture, sbrdf, _ = measured
    stack = capture.stack
    found = specular_component(stack, sbrdf)
    samples = np.array([stack.linear(i) for i in range(len(stack.rig))], np.float64)
    light = samples.mean(axis=1)
    light[~np.isfinite(light)] = -np.inf
    best = light.argmax(axis=0)
    diffuse = sbrdf.diffuse.astype(np.float64)
    for y, x in ((3, 5), (20, 41), (60, 9)):
        i = best[y, x]
        cosine = max(float(stack.rig.directions[i] @ sbrdf.normal[:, y, x]), 0.0)
        cosine *= stack.rig.intensities[i]
        expected = samples[i, :, y, x] - diffuse[:, y, x] * cosine
        # Single precision of samples of at most 2.
        np.testing.assert_allclose(found[:, y, x], expected, atol=2e-6)


def test_the_diffuse_part_of_the_estimated_spectrum_gives_the_same_gloss(
    measured: Measured,
) -> None:
    """``rho_D`` "by using the estimated reflectance": H s of eq. 4 for the colours."""
    capture, sbrdf, reflectance = measured
    system = systems.get(PAPERS[capture.stack.shape[1] == 6])
    operator = capture.truth.camera.operator(reflectance.wavelengths)
    responses = np.tensordot(operator @ reflectance.basis.T, reflectance.coefficients, axes=1)
    albedo = np.ascontiguousarray(responses, dtype=np.float32)
    # Three components reproduce three responses; the Wiener estimate misses them by its noise
    # term, 1e-4 to 1e-3 of white.
    np.testing.assert_allclose(albedo, sbrdf.diffuse, atol=3e-3)
    again = system.fit_sbrdf(capture.stack, replace(sbrdf.normals, albedo=albedo))
    # A change d of the colour changes a specular part of F beta = 0.4 by d / 0.4 at most, and with
    # both signs, so that less than a tenth of it remains: 1e-4 for a mean of 3e-4.
    assert (again.beta, again.gamma) == pytest.approx((sbrdf.beta, sbrdf.gamma), rel=1e-4)


def test_impasto_s_own_system_is_the_default_of_every_function() -> None:
    capture = simulate.default_capture(size=(32, 32))
    sbrdf, reflectance = systems.get("impasto").measure(capture.stack, capture.truth.camera)
    expected = impasto.fit_sbrdf(capture.stack, pooling="painting")
    assert (sbrdf.beta, sbrdf.gamma) == (expected.beta, expected.gamma)
    np.testing.assert_array_equal(sbrdf.normal, expected.normal)
    spectra = impasto.fit_reflectance(capture.stack, expected, capture.truth.camera)
    np.testing.assert_array_equal(reflectance.coefficients, spectra.coefficients)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(impasto.ArgumentError, match="name: expected 'impasto' or 'tominaga-rgb"):
        systems.get("tominaga")  # type: ignore[arg-type]
    capture = simulate.default_capture("tominaga-six-band-adaptation", size=(32, 32))
    with pytest.raises(impasto.ArgumentError, match="photographs of 3 bands, found 6"):
        systems.get("tominaga-rgb-camera").measure(capture.stack, capture.truth.camera)
    rgb = simulate.default_capture("tominaga-rgb-camera", size=(16, 16))
    with pytest.raises(impasto.ArgumentError, match="photographs of 6 bands, found 3"):
        systems.get("tominaga-six-band-adaptation").measure(rgb.stack, rgb.truth.camera)
    with pytest.raises(impasto.ArgumentError, match="camera: expected"):
        systems.get("tominaga-rgb-camera").measure(rgb.stack)
    with pytest.raises(impasto.ArgumentError, match="estimates no spectra"):
        systems.get("snel-lafortune").measure(rgb.stack, rgb.truth.camera)


@pytest.mark.parametrize("name", PAPERS)
def test_a_system_is_one_option_of_the_command_line(tmp_path: Path, name: str) -> None:
    demo, out = tmp_path / "demo", tmp_path / "out"
    assert main(["demo", "--system", name, "--out", str(demo), "--size", "48", "--quiet"]) == 0
    shot = demo / "photographs"
    words = f"fit {shot} --dark 1024 --saturation 65520 --system {name} --out {out} --quiet"
    assert main([*words.split(), "--camera", str(shot / "camera.csv")]) == 0
    drawn = {"figure-10", "figure-11"} if name == PAPERS[0] else {"figure-2", "figure-6"}
    for folder in (demo, out):
        for picture in drawn | set(systems.get(name).pictures):
            assert cv2.imread(str(folder / f"{picture}.png")).std() > 5
    again = tmp_path / "again"
    assert main(["render", str(out), "--system", name, "--out", str(again), "--quiet"]) == 0
    for picture in systems.get(name).pictures:
        files = [folder / f"{picture}.png" for folder in (out, again)]
        assert files[0].read_bytes() == files[1].read_bytes()
    reports = [json.loads((folder / "report.json").read_text("utf-8")) for folder in (demo, out)]
    for report in reports:
        assert report["options"]["system"] == name
        assert report["options"]["joint"] is False
    beta = [report["results"]["beta"] for report in reports]
    assert beta[0] == beta[1]


def test_a_paper_s_system_needs_a_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"fit nowhere --system tominaga-rgb-camera --out {tmp_path / 'out'}"
    assert main(words.split()) == 2
    assert "it needs --camera" in capsys.readouterr().err


def test_a_camera_of_other_bands_fails_before_the_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    from impasto.cli.console import Stages
    from impasto.cli.measuring import measured

    def late(*_: object, **__: object) -> None:
        pytest.fail("the fit has begun")

    monkeypatch.setattr(systems.System, "fit_normals", late)
    taken = simulate.default_capture("tominaga-rgb-camera", size=(8, 8))
    system, right = systems.get("impasto"), taken.truth.camera
    order = ("blue", "green", "red")
    turned = impasto.Camera(right.wavelengths, right.sensitivities[::-1], "A", bands=order)
    for wrong, words in (
        (simulate.camera("six-band"), "camera: expected the 3 bands"),
        (turned, "camera: its bands blue, green, red are those of the photographs in another"),
    ):
        with pytest.raises(impasto.ArgumentError, match=words):
            system.measure(taken.stack, wrong)
        with pytest.raises(impasto.ArgumentError, match=words):
            measured(Stages(quiet=True), system, taken.stack, wrong, None)
