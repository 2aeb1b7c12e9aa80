"""A refined rig of which nobody knows how wide a pixel is: lengths in pixels are not called mm.

The oracle is that light does not know a unit: a painting, its lamps and its camera that are all
half as large make the same picture.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto import DistantLight, PointLight, PointView, Rig, Scene, export
from impasto.cli import main
from impasto.export.source import Source
from impasto.refinement import Estimate, RigRefinement
from impasto.viewer import Contents
from oracles.rigs import spiral
from test_rig_refinement import photographs

LAMP = Scene([DistantLight((0.3, 0.5, 0.8))])
FAR = 40.0
"""Distance of the camera in pixels: 1.7 sides, near enough to be seen in every highlight."""


@pytest.fixture(scope="module")
def fitted() -> impasto.Sbrdf:
    """With a camera at a distance in pixels, as a refinement without a width finds it."""
    stack = photographs(np.inf, np.inf)[1]
    none = Estimate(np.inf, False, "not estimated")
    found = RigRefinement(none, none, none, 12.0, 0.0, 0.0, (), in_mm=False)
    rig = Rig(spiral(40), views=PointView((0.0, 0.0, FAR)), pitch_mm=1.0, refinement=found)
    return impasto.fit_sbrdf(stack._replace(rig=rig), pooling="painting", check=False)


def test_a_refinement_says_whether_lengths_are_in_mm() -> None:
    stack = photographs(np.inf, np.inf)[1]
    known = impasto.refine_rig(stack, camera=False, lamps=False)
    assert (known.pitch_mm, known.known_pitch_mm) == (2.0, 2.0)
    unknown = impasto.refine_rig(
        stack._replace(rig=Rig(stack.rig.lights)), camera=False, lamps=False
    )
    assert unknown.known_pitch_mm is None
    assert "mm" not in repr(unknown)
    again = impasto.refine_rig(stack._replace(rig=unknown), camera=False, lamps=False)
    assert again.known_pitch_mm is None, "a pixel that nobody has measured stays so"


def test_a_saved_result_still_does_not_know(fitted: impasto.Sbrdf, tmp_path: Path) -> None:
    for name in ("a.npz", "a.impasto.zarr"):
        fitted.save(tmp_path / name)
        loaded = impasto.load_sbrdf(tmp_path / name)
        assert (loaded.pitch_mm, loaded.known_pitch_mm) == (1.0, None)
    assert impasto.open_sbrdf(tmp_path / "a.impasto.zarr").known_pitch_mm is None
    assert "x" not in fitted.to_xarray().coords


def test_a_width_that_is_given_moves_the_camera_with_it(fitted: impasto.Sbrdf) -> None:
    """The same picture, but for single precision: the arithmetic differs by one factor."""
    plain = impasto.render(fitted, LAMP, fidelity="model").display.astype(int)
    for pitch in (0.5, 0.05):
        given = impasto.render(fitted, LAMP, fidelity="model", pitch_mm=pitch).display
        assert np.abs(given - plain).max() <= 1, pitch
    distant = replace(fitted, rig=Rig(spiral(40), pitch_mm=1.0))
    flat = impasto.render(distant, LAMP, fidelity="model").display
    assert np.abs(flat - plain).max() > 3, "a camera far away shows something else"


def test_lamps_in_mm_need_a_width(fitted: impasto.Sbrdf) -> None:
    near = Scene([PointLight((0.0, 20.0, 20.0))])
    with pytest.raises(impasto.GeometryError, match="pitch_mm: point lights need the width"):
        impasto.render(fitted, near)
    assert impasto.render(fitted, near, pitch_mm=1.0).display.std() > 1


def test_the_page_has_a_scale_only_where_it_is_known(
    fitted: impasto.Sbrdf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted.save(tmp_path / "a.impasto.zarr")
    for result in (fitted, impasto.open_sbrdf(tmp_path / "a.impasto.zarr")):
        document = Contents(result).document
        assert document["pitch"] is None
        assert document["eye"] == {"position": [0.0, 0.0, FAR]}
        document = Contents(result, pitch_mm=0.5).document
        assert document["pitch"] == 0.5
        assert document["eye"] == {"position": [0.0, 0.0, 0.5 * FAR]}
    words = ["export", "web", str(tmp_path / "a.impasto.zarr"), "--out", str(tmp_path / "site")]
    assert main(words) == 0
    assert "no lengths in mm" in capsys.readouterr().err
    assert main([*words, "--pitch", "0.5", "--camera", "srgb"]) == 0
    said = capsys.readouterr().err
    assert "no lengths in mm" not in said
    assert "no colour of the light" not in said


def test_heights_say_their_unit(
    fitted: impasto.Sbrdf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.npz", "a.impasto.zarr"):
        fitted.save(tmp_path / name)
        words = ["height", str(tmp_path / name), "--out", str(tmp_path / "a.tif")]
        assert main(words) == 0
        assert "in pixels: --pitch says" in " ".join(capsys.readouterr().err.split())
        unit = impasto.io.read_image(tmp_path / "a.tif")
        assert main([*words, "--pitch", "0.25"]) == 0
        assert "in mm" in capsys.readouterr().err
        found = impasto.io.read_image(tmp_path / "a.tif")
        # Heights are lengths: a quarter, but for the last bits of single precision.
        assert np.allclose(found, 0.25 * unit, atol=1e-6 * np.abs(unit).max())


def test_exports_say_that_a_size_stands_in(fitted: impasto.Sbrdf, tmp_path: Path) -> None:
    assert Source(fitted).pitch_mm is None
    report = export.to("gltf", fitted, tmp_path / "a.glb")
    assert "1 mm per pixel stands in" in " ".join(report.lost)
    known = export.to("gltf", fitted, tmp_path / "b.glb", pitch_mm=0.25)
    assert "per pixel stands in" not in " ".join(known.lost)
    # What the exports are compared with has the same camera at every width.
    assert abs(known.p95 - report.p95) < 0.05
    export.to("openlime", fitted, tmp_path / "layers")
    assert "pixelSizeInMM" not in json.loads((tmp_path / "layers" / "layers.json").read_text())


def test_the_smaller_scales_of_a_job_have_no_unit(fitted: impasto.Sbrdf, tmp_path: Path) -> None:
    stack = photographs(np.inf, np.inf)[1]
    for name, rig, unit in (("a", fitted.rig, None), ("b", Rig(spiral(40), pitch_mm=2.0), "mm")):
        taken = stack._replace(rig=rig)
        store = impasto.run(taken, tmp_path / f"{name}.zarr", pooling="painting", tile=16)
        ome = json.loads((store / "zarr.json").read_text())["attributes"]["ome"]
        axes = ome["multiscales"][0]["axes"][1:]
        assert [axis.get("unit") for axis in axes] == 2 * [unit and "millimeter"]
