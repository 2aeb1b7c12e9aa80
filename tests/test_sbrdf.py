"""`fit_sbrdf`: what goes in, what comes out, what is refused, and what a file keeps."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Status, simulate
from oracles import forward as oracle

SHAPE = (24, 40)
BETA, GAMMA = 12.0, 0.12


def relief(shape: tuple[int, int] = SHAPE, seed: int = 3) -> tuple[Any, Any]:
    """Normals that lean up to some 20 degrees, and colours of three bands."""
    rng = np.random.default_rng(seed)
    slopes = rng.normal(0.0, 0.17, (2, *shape))
    normal = np.stack([*slopes, np.ones(shape)])
    normal /= np.linalg.norm(normal, axis=0)
    return normal.astype(np.float32), rng.uniform(0.1, 0.7, (3, *shape)).astype(np.float32)


def stack_of(samples: Any, rig: Any = None, **options: Any) -> impasto.Stack:
    rig = simulate.rig("tominaga-six-band-adaptation") if rig is None else rig
    return impasto.Stack(samples, lights=rig, **options)


@pytest.fixture(scope="module")
def clean() -> impasto.Stack:
    """Noiseless samples of the oracle's model (not of ours)."""
    normal, diffuse = relief()
    rig = simulate.rig("tominaga-six-band-adaptation")
    return stack_of(oracle.stack(normal, diffuse, np.full(SHAPE, BETA), np.full(SHAPE, GAMMA), rig))


@pytest.fixture(scope="module")
def fitted(clean: impasto.Stack) -> impasto.PooledSbrdf:
    return impasto.fit_sbrdf(clean, pooling="painting")


def test_the_truth_is_found_again(fitted: impasto.PooledSbrdf) -> None:
    normal, diffuse = relief()
    assert fitted.verdict == "fitted"
    # Nothing but single precision stands between samples and truth: the lobe's peak of 0.4 carries
    # 1e-7, the fit stops where its relative gain does. A few pixels keep a lost normal and pull.
    assert fitted.beta == pytest.approx(BETA, rel=1e-2)
    assert fitted.gamma == pytest.approx(GAMMA, rel=1e-2)
    tilt = np.linalg.norm(fitted.normal - normal, axis=0)
    assert np.median(tilt) < np.radians(0.1)
    assert np.median(np.abs(fitted.diffuse - diffuse)) < 2e-3


def test_maps_have_the_promised_shapes_and_types(fitted: impasto.PooledSbrdf) -> None:
    assert fitted.normal.shape == (3, *SHAPE)
    assert fitted.diffuse.shape == (3, *SHAPE)
    assert fitted.residual.shape == fitted.status.shape == fitted.shape == SHAPE
    assert {fitted.normal.dtype, fitted.diffuse.dtype, fitted.residual.dtype} == {
        np.dtype(np.float32)
    }
    assert fitted.status.dtype == np.uint8
    assert fitted.covariance.shape == (2, 2)
    assert fitted.curve.shape[1] == 3
    assert fitted.bands == ("red", "green", "blue")
    np.testing.assert_allclose(np.linalg.norm(fitted.normal, axis=0), 1.0, atol=1e-6)


def test_the_stereo_stage_keeps_its_maps(clean: impasto.Stack) -> None:
    stereo = impasto.fit_normals(clean)
    before = stereo.normal.copy()
    fitted = impasto.fit_sbrdf(clean, normals=stereo, pooling="painting")
    assert fitted.normals is stereo
    assert stereo.normal.tobytes() == before.tobytes()
    assert fitted.normal.tobytes() != before.tobytes()
    assert (
        impasto.fit_sbrdf(clean, normals="least-squares", pooling="painting").normals.method
        == "least-squares"
    )


def test_numbers_stand_exactly_where_the_status_says_so(clean: impasto.Stack) -> None:
    samples = clean.samples.copy()
    mask = np.ones(SHAPE, bool)
    samples[:, :, 2, 3] = 0.0
    samples[:, :, 4, 5] = np.nan
    samples[:, :, 6, 7] = np.inf
    samples[2:, :, 8, 9] = np.nan
    mask[10, 11] = False
    fitted = impasto.fit_sbrdf(stack_of(samples, mask=mask), pooling="painting")
    lost = fitted.status >= 16
    assert {(2, 3), (4, 5), (6, 7), (8, 9), (10, 11)} == set(zip(*np.nonzero(lost), strict=True))
    assert fitted.status[2, 3] == Status.DARK
    assert fitted.status[10, 11] == Status.MASKED
    for name in ("normal", "residual", "sigma"):
        values = getattr(fitted, name)
        np.testing.assert_array_equal(np.isnan(values), np.broadcast_to(lost, values.shape))
    dark = fitted.status == Status.DARK
    np.testing.assert_array_equal(
        np.isnan(fitted.diffuse), np.broadcast_to(lost & ~dark, fitted.diffuse.shape)
    )
    assert (fitted.diffuse[:, dark] == 0.0).all()
    assert not np.isinf(fitted.diffuse).any()
    assert np.isnan(fitted.predict()[:, :, lost]).all()


def test_predict_takes_lights_in_every_form(
    clean: impasto.Stack, fitted: impasto.PooledSbrdf
) -> None:
    own = fitted.predict()
    assert own.shape == clean.shape
    assert own.tobytes() == fitted.predict(clean.rig).tobytes()
    directions = clean.rig.directions
    lights = [impasto.DistantLight(tuple(v)) for v in directions]
    assert fitted.predict(directions[:2]).tobytes() == fitted.predict(lights[:2]).tobytes()
    slanted = fitted.predict(views=[0.3, 0.0, 1.0])
    assert slanted.shape == own.shape
    assert slanted.tobytes() != own.tobytes()
    near = impasto.Rig([impasto.PointLight((0.0, 50.0, 100.0))], pitch_mm=0.3)
    assert fitted.predict(near).shape == (1, *own.shape[1:])
    # Median of all samples: pixels that the fit lost count for little.
    assert np.median(np.abs(own - clean.samples)) < 1e-3


def test_what_is_saved_is_read_again(fitted: impasto.PooledSbrdf, tmp_path: Path) -> None:
    fitted.save(tmp_path / "surface.npz")
    again = impasto.load_sbrdf(tmp_path / "surface.npz")
    for field in fields(fitted):
        if field.name not in {"normals", "rig"}:
            np.testing.assert_array_equal(getattr(again, field.name), getattr(fitted, field.name))
    for field in fields(fitted.normals):
        np.testing.assert_array_equal(
            getattr(again.normals, field.name), getattr(fitted.normals, field.name)
        )
    assert type(again.beta) is float
    assert again.bands == fitted.bands
    assert repr(again) == repr(fitted)
    # Directions are normalised once more: one rounding of 1e-16.
    np.testing.assert_allclose(again.rig.directions, fitted.rig.directions, rtol=0, atol=1e-15)
    assert again.pitch_mm == fitted.pitch_mm
    assert [entry.name for entry in tmp_path.iterdir()] == ["surface.npz"]


def test_damaged_files_are_refused(fitted: impasto.PooledSbrdf, tmp_path: Path) -> None:
    path = tmp_path / "surface.npz"
    fitted.save(path)
    whole = path.read_bytes()
    for share in (0, 10, len(whole) // 2, len(whole) - 3):
        path.write_bytes(whole[:share])
        with pytest.raises(impasto.CorruptInputError, match=r"surface\.npz"):
            impasto.load_sbrdf(path)
    path.write_bytes(whole[:5000] + b"\xff" * 64 + whole[5064:])
    with pytest.raises(impasto.CorruptInputError):
        impasto.load_sbrdf(path)
    np.savez(path, samples=np.zeros(3))
    with pytest.raises(impasto.CorruptInputError, match="something else"):
        impasto.load_sbrdf(path)
    np.savez(path, kind=np.array("impasto.PooledSbrdf"), status=np.zeros(SHAPE, np.uint8))
    with pytest.raises(impasto.CorruptInputError, match="no array"):
        impasto.load_sbrdf(path)
    with pytest.raises(FileNotFoundError):
        impasto.load_sbrdf(tmp_path / "nowhere.npz")


def test_a_file_whose_maps_disagree_is_refused(fitted: impasto.PooledSbrdf, tmp_path: Path) -> None:
    path = tmp_path / "surface.npz"
    fitted.save(path)
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    np.savez(path, **(arrays | {"normal": arrays["normal"][:, :3]}))
    with pytest.raises(impasto.CorruptInputError, match="normal"):
        impasto.load_sbrdf(path)


def test_other_formats_are_refused_with_what_works(
    fitted: impasto.PooledSbrdf, tmp_path: Path
) -> None:
    with pytest.raises(impasto.ArgumentError, match=r"\.npz or \.zarr, found 'icon\.mat'"):
        fitted.save(tmp_path / "icon.mat")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("model", "phong"),
        ("pooling", "brush"),
        ("extraction", "mean"),
        ("index", 0.9),
        ("index", float("nan")),
        ("index", "1.45"),
        ("normals", np.zeros((3, 4, 4))),
        ("normals", "magic"),
        ("threads", 0),
        ("progress", 3),
        ("residuals", "yes"),
        ("refine", "yes"),
        ("relief", "yes"),
        ("effort", "most"),
    ],
)
def test_a_wrong_argument_is_named_before_any_work(
    clean: impasto.Stack, argument: str, value: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(*_: Any, **__: Any) -> None:
        raise AssertionError("a fit has begun")

    for numerics in ("fit_normals", "learn_normals", "fit_lobes", "learn_pooled"):
        monkeypatch.setattr(impasto._core, numerics, work)
    for fit in (impasto.fit_sbrdf, impasto.learn_sbrdf):
        with pytest.raises(impasto.ArgumentError, match=argument):
            fit(clean, **{argument: value})


def test_normals_of_another_stack_are_refused(clean: impasto.Stack) -> None:
    other = impasto.fit_normals(stack_of(clean.samples[:, :, :5]))
    with pytest.raises(impasto.ArgumentError, match=r"normals: .*\(3, 5, 40\)"):
        impasto.fit_sbrdf(clean, normals=other, pooling="painting")


def test_the_summary_says_what_matters(fitted: impasto.PooledSbrdf) -> None:
    text = repr(fitted)
    assert "40 x 24 pixels, 3 bands, 100.0 % estimated" in text
    assert "beta 1" in text
    assert "gamma 0.1" in text
    errors = [float(error) for error in re.findall(r"± ([^ ]+) %", text)]
    assert len(errors) == 2
    assert min(errors) > 0.0, "however small, it is none of 0"
    doubtful = replace(fitted, covariance=np.diag([2.25, 0.01]))
    assert "± 150 %" in repr(doubtful)
    assert "± 10 %" in repr(doubtful)
