"""Bad input ends in an error that names the file or the argument, or in a status.

One test for each case, through every door that the input may come in by: `read_stack`, the doctor,
the fits, the renderer and the command line. Never a crash, a NaN without a status, or a picture
that is silently wrong.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from impasto import (
    ArgumentError,
    CorruptInputError,
    DistantLight,
    GeometryError,
    ImpastoError,
    Scene,
    Stack,
    Status,
    doctor,
    fit_normals,
    fit_sbrdf,
    read_stack,
    render,
    simulate,
)
from impasto.cli import main
from impasto.fit.normals import METHODS
from impasto.io import (
    read_image,
    read_lights,
    write_exr,
    write_lights,
    write_png16,
    write_stack,
    write_tiff16,
)

RIG = "tominaga-rgb-camera"
SIZE = (24, 32)


@cache
def stack() -> Stack:
    """Nine clean photographs as float32, white board at 1."""
    painting = simulate.painting(2, SIZE, varnish="satin")
    capture = simulate.capture(painting, RIG, bits=None, noise=False, clip=False)
    return Stack(capture.stack.samples, lights=capture.stack.rig.directions, saturation=4.0)


def session(folder: Path, suffix: str = ".png") -> Path:
    """The photographs as files beside ``dirs.lp``; the path of that."""
    folder.mkdir(exist_ok=True)
    names = [f"photo{i + 1}{suffix}" for i in range(len(stack().rig))]
    for name, light in zip(names, stack().samples, strict=True):
        picture = np.clip(light / 2.0, 0.0, 1.0)
        if suffix == ".exr":
            write_exr(folder / name, dict(zip("RGB", picture, strict=True)))
        elif suffix == ".jpg":
            eight = np.moveaxis(np.rint(255 * picture[::-1]).astype(np.uint8), 0, -1)
            cv2.imwrite(str(folder / name), np.ascontiguousarray(eight))
        else:
            write = write_png16 if suffix == ".png" else write_tiff16
            write(folder / name, np.rint(65535 * picture).astype(np.uint16))
    write_lights(folder / "dirs.lp", stack().rig.directions, names)
    return folder / "dirs.lp"


def altered(samples: np.ndarray, lights: np.ndarray | None = None, **options: Any) -> Stack:
    return Stack(samples, lights=stack().rig.directions if lights is None else lights, **options)


def attempt(
    function: Callable[..., Any], *arguments: Any, **options: Any
) -> tuple[Any, ImpastoError | None]:
    """What a function returns, or the error that it raises on purpose."""
    try:
        return function(*arguments, **options), None
    except ImpastoError as error:
        return None, error


def told(capsys: pytest.CaptureFixture[str], *words: object) -> int:
    """Run the command line; the exit code. One line of complaint, never a traceback."""
    code = main([str(word) for word in words])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err + captured.out
    told.err, told.out = captured.err, captured.out  # type: ignore[attr-defined]
    return code


def assert_honest(fitted: Any) -> None:
    """NaN stands exactly where the status says that the quantity could not be estimated."""
    unknown = fitted.status >= 16
    np.testing.assert_array_equal(np.isnan(fitted.normal), np.broadcast_to(unknown, (3, *SIZE)))
    dark = fitted.status == Status.DARK
    missing = np.isnan(fitted.albedo)
    np.testing.assert_array_equal(missing, np.broadcast_to(unknown & ~dark, missing.shape))
    for name in ("residual", "sigma"):
        nan = np.isnan(getattr(fitted, name))
        assert (nan[unknown]).all()
        assert not nan[~unknown & (fitted.status != Status.EXACT)].any(), name
    for name in ("normal", "albedo", "residual", "condition", "sigma"):
        assert not np.isinf(getattr(fitted, name)).any(), name


@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr", ".jpg"])
def test_a_truncated_photograph(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    path = session(tmp_path / "session", suffix)
    torn = path.parent / f"photo4{suffix}"
    torn.write_bytes(torn.read_bytes()[: -torn.stat().st_size // 3])
    with pytest.raises(CorruptInputError, match=torn.name):
        read_stack(path)
    assert told(capsys, "doctor", path) == 3
    assert torn.name in told.err
    assert told(capsys, "fit", path, "--out", tmp_path / "out", "--quiet") == 3
    assert torn.name in told.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_lights(tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int) -> None:
    path = session(tmp_path / "session")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([str(count), *lines[1 : count + 1]]) + "\n")
    read = read_stack(path)
    assert read.shape[0] == count
    diagnosis = doctor.examine(read)
    assert diagnosis["lights"].severity == "error"
    for fit in (fit_normals, fit_sbrdf):
        with pytest.raises(GeometryError, match="lights"):
            fit(read)
    assert told(capsys, "doctor", path) == 1
    assert told(capsys, "fit", path, "--out", tmp_path / "out", "--quiet") == 1
    assert "light" in told.err
    assert not (tmp_path / "out").exists()


def test_three_lights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exactly determined: a result, but neither residual nor predicted error."""
    three = stack().take([1, 4, 6])
    assert doctor.examine(three)["lights"].severity == "warning"
    for method in METHODS:
        normals = fit_normals(three, method=method)
        assert_honest(normals)
        exact = normals.status == Status.EXACT
        # The papers' thresholds may call one of the three a highlight.
        assert exact.all() or method == "threshold"
        assert np.isnan(normals.residual[exact]).all()
        assert np.isnan(normals.sigma[exact]).all()
    path = session(tmp_path / "session")
    lines = path.read_text().splitlines()
    path.write_text("\n".join(["3", lines[2], lines[5], lines[7]]) + "\n")
    assert told(capsys, "doctor", path) == 0
    assert told(capsys, "fit", path, "--out", tmp_path / "out", "--quiet") == 0
    assert (fit_sbrdf(three, pooling="painting").status == Status.EXACT).all()


def test_lights_in_one_plane(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat = np.stack([np.linspace(-0.8, 0.8, 9), np.zeros(9), np.ones(9)], axis=1)
    bad = altered(stack().samples, flat)
    assert doctor.examine(bad)["conditioning"].severity == "error"
    with pytest.raises(GeometryError, match=r"lights.*plane"):
        fit_normals(bad)
    path = session(tmp_path / "session")
    write_lights(path, flat, [f"photo{i + 1}.png" for i in range(9)])
    assert told(capsys, "doctor", path) == 1
    assert told(capsys, "fit", path, "--out", tmp_path / "out", "--quiet") == 1
    assert "plane" in told.err


def test_photographs_of_different_sizes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = session(tmp_path / "session")
    write_png16(path.parent / "photo7.png", np.zeros((3, 24, 31), np.uint16))
    with pytest.raises(ArgumentError, match=r"photo7\.png.*31 x 24.*photo1\.png.*32 x 24"):
        read_stack(path)
    for command in (["doctor", path], ["fit", path, "--out", tmp_path / "out", "--quiet"]):
        assert told(capsys, *command) == 1
        assert "photo7.png" in told.err
        assert "photo1.png" in told.err


def test_case_26_samples_that_are_not_numbers() -> None:
    """A pixel that lost some samples is fitted from the rest; neighbours do not change by a bit."""
    samples = stack().samples.copy()
    samples[2, 1, 5, 7] = np.nan  # one band of one photograph
    samples[:6, :, 9, 11] = np.nan  # three photographs are left
    samples[:7, :, 10, 11] = np.nan  # two
    samples[:, :, 3, 4] = np.nan  # none
    samples[1, :, 4, 4] = -np.inf
    samples[1, :, 4, 5] = np.inf  # known to be clipped
    bad = altered(samples)
    touched = np.zeros(SIZE, bool)
    for at in ((5, 7), (9, 11), (10, 11), (3, 4), (4, 4), (4, 5)):
        touched[at] = True
    for method in METHODS:
        normals, clean = fit_normals(bad, method=method), fit_normals(altered(stack().samples),
                                                                      method=method)  # fmt: skip
        assert_honest(normals)
        assert normals.status[3, 4] == Status.INVALID_INPUT
        assert normals.status[10, 11] >= 16
        assert normals.status[9, 11] in {Status.EXACT, Status.ILL_CONDITIONED}
        assert normals.status[5, 7] < 16
        assert normals.status[4, 4] < 16
        assert normals.status[4, 5] < 16
        np.testing.assert_array_equal(normals.normal[:, ~touched], clean.normal[:, ~touched])
    assert doctor.examine(bad)["missing-samples"].severity == "note"


def test_cases_1_2_black_and_saturated_pixels() -> None:
    samples = stack().samples.copy()
    samples[:, :, 2, 3] = 0.0
    samples[:, :, 6, 8] = 5.0
    bad = altered(samples, saturation=4.0)
    for method in METHODS:
        normals = fit_normals(bad, method=method)
        assert_honest(normals)
        assert normals.status[2, 3] == Status.DARK
        assert (normals.albedo[:, 2, 3] == 0).all()
        assert normals.status[6, 8] == Status.SATURATED
        assert (normals.status < 16).sum() == SIZE[0] * SIZE[1] - 2


def spoiled() -> tuple[Stack, dict[tuple[int, int], set[Status]]]:
    """Single pixels spoiled in every way, and the statuses that each may get."""
    samples = stack().samples.copy()
    samples[:, :, 2, 3] = 0.0
    samples[:, :, 6, 8] = 5.0
    samples[:, :, 3, 4] = np.nan
    samples[:7, :, 10, 11] = np.nan
    samples[:6, :, 9, 11] = np.nan
    expected = {
        (2, 3): {Status.DARK},
        (6, 8): {Status.SATURATED},
        (3, 4): {Status.INVALID_INPUT},
        (10, 11): {Status.TOO_FEW_SAMPLES},
        (9, 11): {Status.EXACT, Status.ILL_CONDITIONED},
    }
    return altered(samples, saturation=4.0), expected


def test_spoiled_pixels_through_fit_and_picture() -> None:
    """They have their status, stay dark in every picture, and disturb neither gloss nor others."""
    bad, expected = spoiled()
    sbrdf, clean = fit_sbrdf(bad, pooling="painting"), fit_sbrdf(stack(), pooling="painting")
    for at, statuses in expected.items():
        assert Status(int(sbrdf.status[at])) in statuses
    unknown = sbrdf.status >= 16
    assert unknown.sum() == 4
    np.testing.assert_array_equal(np.isnan(sbrdf.normal).any(axis=0), unknown)
    dark = sbrdf.status == Status.DARK
    np.testing.assert_array_equal(np.isnan(sbrdf.diffuse).any(axis=0), unknown & ~dark)
    np.testing.assert_array_equal(np.isnan(sbrdf.predict()).any(axis=(0, 1)), unknown)
    # Five of 768 pixels are other ones: the pooled lobe moves by less than a percent.
    assert sbrdf.beta == pytest.approx(clean.beta, rel=0.01)
    assert sbrdf.gamma == pytest.approx(clean.gamma, rel=0.01)
    picture = render(sbrdf, Scene(lights=[DistantLight((0.5, 0.5, 0.7))]))
    assert np.isfinite(picture.linear).all()
    assert (picture.linear[:, unknown] == 0).all()
    assert (picture.linear[:, ~unknown] > 0).any()


def test_the_last_bit_of_clean_samples_decides_nothing() -> None:
    """Every pixel may end where rounding is all that is left of it: it knows the lobe all the same.

    A search ends where a step gains a millionth of the cost: a part in ten thousand of beta, and
    here of two ends.
    """
    clean = fit_sbrdf(stack(), pooling="painting")
    rng = np.random.default_rng(0)
    for _ in range(12):
        up, down = (np.nextafter(stack().samples, np.float32(end)) for end in (9.0, -9.0))
        samples = np.choose(rng.integers(0, 3, up.shape), [down, stack().samples, up])
        other = fit_sbrdf(altered(samples, saturation=4.0), pooling="painting")
        assert other.verdict == "fitted"
        assert other.beta == pytest.approx(clean.beta, rel=2e-4)
        assert other.gamma == pytest.approx(clean.gamma, rel=2e-4)
        # Known to rounding: some 1e-7 of a sample, and not better than that.
        assert 0.0 < other.covariance[0, 0] < 1e-4**2
        assert 0.0 < other.covariance[1, 1] < 1e-4**2


def test_clean_samples_of_matte_paint_show_no_highlight() -> None:
    """Pixels that rounding alone is left of know that there is none, too."""
    matte = simulate.capture(
        simulate.painting(2, SIZE, varnish=None), RIG, bits=None, noise=False, clip=False
    ).stack
    rng = np.random.default_rng(0)
    for _ in range(12):
        up, down = (np.nextafter(matte.samples, np.float32(end)) for end in (9.0, -9.0))
        samples = np.choose(rng.integers(0, 3, up.shape), [down, matte.samples, up])
        found = fit_sbrdf(
            Stack(samples, lights=matte.rig.directions, saturation=4.0), pooling="painting"
        )
        assert found.verdict == "no-highlight"
        assert found.beta == 0.0


@pytest.mark.parametrize("value", [0.0, 5.0, np.nan])
def test_a_fit_of_nothing_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], value: float
) -> None:
    path = tmp_path / "stack.npz"
    write_stack(path, altered(np.full_like(stack().samples, value), saturation=4.0))
    sbrdf = fit_sbrdf(read_stack(path), pooling="painting")
    assert (sbrdf.verdict, sbrdf.beta) == ("too-few", 0.0)
    assert (sbrdf.status >= 16).all()
    assert told(capsys, "fit", path, "--out", tmp_path / "out") == 4
    assert "no pixel could be measured" in told.err
    assert told(capsys, "render", tmp_path / "out", "--light", "45,45", "--out",
                tmp_path / "picture.png") == 0  # fmt: skip
    assert (read_image(tmp_path / "picture.png") == 0).all()


@pytest.mark.parametrize("value", [0.0, 5.0, np.nan])
def test_nothing_but_black_saturated_or_missing_samples(value: float) -> None:
    bad = altered(np.full_like(stack().samples, value), saturation=4.0)
    diagnosis = doctor.examine(bad)
    assert not diagnosis.usable
    normals = fit_normals(bad)
    assert_honest(normals)
    expected = Status.DARK if value == 0 else Status.SATURATED if value == 5 else None
    assert (normals.status == (Status.INVALID_INPUT if expected is None else expected)).all()


def test_a_stack_of_one_pixel() -> None:
    tiny = altered(stack().samples[:, :, :1, :1])
    assert fit_normals(tiny).status[0, 0] < 16
    assert doctor.examine(tiny).usable


@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr", ".jpg"])
def test_damage_anywhere_in_a_photograph(tmp_path: Path, suffix: str) -> None:
    """Cut short or with wrong bytes: a picture of the right shape, or an error naming the file."""
    rng = np.random.default_rng(11)
    whole = (session(tmp_path / "session", suffix).parent / f"photo1{suffix}").read_bytes()
    path = tmp_path / f"damaged{suffix}"
    for trial in range(120):
        data = bytearray(whole)
        if trial % 2:
            del data[int(rng.integers(0, len(data))) :]
        else:
            for at in rng.integers(0, min(len(data), 400 if trial % 4 else len(data)), 3):
                data[at] = int(rng.integers(0, 256))
        path.write_bytes(data)
        picture, error = attempt(read_image, path, max_pixels=1 << 20)
        assert picture is None or picture.ndim == 3
        assert error is None or path.name in str(error)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "3",
        "2\na.png 0 0 1\nb.png 0 nan 1\n",
        "2\na.png 0 0 1\nb.png 0 inf 1\n",
        "2\na.png 0 0 1\nb.png 0 0 0\n",
        "2\na.png 0 0 1\nb.png 0 1\n",
        "2\na.png 0 0 1\n0 0 1\n",
        "\x00\x01\x02\x03",
        "1e400\na.png 1e400 0 1\n",
    ],
)
def test_damaged_light_files(tmp_path: Path, text: str) -> None:
    path = tmp_path / "dirs.lp"
    path.write_text(text)
    with pytest.raises(CorruptInputError, match=r"dirs\.lp"):
        read_lights(path)


@pytest.mark.parametrize("suffix", [".json", ".dome", ".relight"])
@pytest.mark.parametrize(
    "content",
    [
        "",
        "[1, 2]",
        "{}",
        "null",
        '{"lights": {"a": 5}}',
        '{"lights": {"a": {"direction": "up"}}}',
        '{"lights": {"a": {"direction": [0, 0]}}}',
        '{"lights": {}}',
        '{"images": [1, 2]}',
        '{"images": []}',
        '{"images": [{"filename": "a.png", "direction": {"x": "left"}}]}',
        '{"images": [{"filename": "a.png"}], "dome": {"directions": 7}}',
        '{"directions": "abc"}',
        '{"directions": [{"x": 0, "y": 0}]}',
        '{"directions": [{"x": 0, "y": 0, "z": 1}], "verticalOffset": "high"}',
        '{"positions3d": [{"x": 0, "y": 0, "z": 0}], "lightConfiguration": "lights3d"}',
        '{"directions": [{"x": 0, "y": 0, "z": 1}], "ledAdjust": [5]}',
        '{"directions": [{"x": 0, "y": 0, "z": 1}], "imageWidth": {"a": 1}}',
        '{"directions": [[0, 0, 1], [0, 1]]}',
        '{"directions": [{"x": NaN, "y": 0, "z": 1}]}',
    ],
)
def test_damaged_light_projects(tmp_path: Path, suffix: str, content: str) -> None:
    path = tmp_path / f"lights{suffix}"
    path.write_text(content)
    lights, error = attempt(read_lights, path)
    assert error is None or (isinstance(error, CorruptInputError) and path.name in str(error))
    assert lights is None or np.isfinite(lights.directions).all()


@pytest.mark.parametrize("number", ["1e999", "1" + 400 * "0"])
@pytest.mark.parametrize("key", ["domeDiameter", "diameter", "imageWidth", "verticalOffset"])
def test_lengths_of_a_dome_are_numbers_that_there_are(
    tmp_path: Path, key: str, number: str
) -> None:
    path = tmp_path / "lights.dome"
    path.write_text(
        '{"directions": [[1, 0, 1]], "lightConfiguration": "spherical", "' + key + f'": {number}}}'
    )
    with pytest.raises(CorruptInputError, match=f"{key}: expected"):
        read_lights(path)


def archive(path: Path, **changes: Any) -> Path:
    """The stack's ``.npz`` with some arrays replaced, or left out (None)."""
    write_stack(path, stack())
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files} | changes
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {"samples": None},
        {"samples": np.zeros((9, 3, 4))[0, 0]},
        {"samples": np.full((9, 3, 4, 4), "x")},
        {"samples": np.zeros((9, 3, 4, 4), complex)},
        {"samples": np.zeros((9, 3, 0, 4))},
        {"lights": np.zeros((9, 3))},
        {"lights": np.full((9, 3), np.nan)},
        {"lights": np.ones((8, 3))},
        {"lights": np.ones((9, 2))},
        {"lights": np.full((9, 3), "x")},
        {"intensities": np.zeros(9)},
        {"intensities": np.ones(3)},
        {"intensities": np.full(9, "x")},
        {"falloff": np.ones(2, bool), "near": np.ones(9, bool)},
        {"near": np.ones(9, bool)},
        {"views": np.zeros((9, 3))},
        {"pitch_mm": np.array(-1.0)},
        {"pitch_mm": np.array("x")},
        {"mask": np.ones((3, 3), bool)},
        {"saturation": np.array([np.nan] * 3)},
        {"saturation": np.ones(5)},
        {"scale": np.zeros(3)},
        {"black": np.array(["x"])},
        {"bands": np.array(["a"])},
        {"names": np.array(["a"])},
        {"curve": np.array("wavy")},
        {"white": np.array(0.0)},
        {"white": np.array("x")},
    ],
    ids=lambda changes: ",".join(f"{k}:{getattr(v, 'shape', v)}" for k, v in changes.items()),
)
def test_damaged_archives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, Any]
) -> None:
    path = archive(tmp_path / "stack.npz", **changes)
    with pytest.raises(ImpastoError, match=r"stack\.npz"):
        read_stack(path)
    assert told(capsys, "doctor", path) in {1, 3}
    assert "stack.npz" in told.err


def test_an_archive_cut_short_or_with_objects(tmp_path: Path) -> None:
    path = archive(tmp_path / "stack.npz")
    whole = path.read_bytes()
    for length in (0, 1, 30, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(CorruptInputError, match=r"stack\.npz"):
            read_stack(path)
    np.savez(path, samples=np.array([{"a": 1}], dtype=object), lights=np.ones((9, 3)))
    with pytest.raises(CorruptInputError, match=r"stack\.npz"):
        read_stack(path)


def test_a_flipped_bit_of_an_archives_directory(tmp_path: Path) -> None:
    path = archive(tmp_path / "stack.npz")
    whole = path.read_bytes()
    entry = whole.index(b"PK\x01\x02")
    refused = []
    # Six bytes into it: the version of ZIP, flags (encrypted, ...), the way it is compressed.
    for place in range(entry + 6, entry + 12):
        for bit in range(8):
            flipped = bytearray(whole)
            flipped[place] ^= 1 << bit
            path.write_bytes(flipped)
            try:
                read_stack(path)
            except CorruptInputError as error:
                refused.append(str(error))
    assert len(refused) > 10
    assert all("stack.npz" in words for words in refused)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"saturation": -1}, "saturation"),
        ({"saturation": float("nan")}, "saturation"),
        ({"saturation": [1, 2]}, "saturation"),
        ({"encoding": "wavy"}, "encoding"),
        ({"encoding": "9"}, "encoding"),
        ({"mask": np.ones((3, 3))}, "mask"),
        ({"mask": np.zeros(SIZE)}, "mask"),
        ({"mask": "nowhere.png"}, "nowhere"),
        ({"white": "nowhere.png"}, "nowhere"),
        ({"dark": "nowhere.png"}, "nowhere"),
        ({"dark": np.ones((7, 7))}, "dark"),
        ({"dark": float("nan")}, "dark"),
        ({"dark": float("inf")}, "dark"),
        ({"dark": [0.0, 65535.0, 0.0]}, "dark"),
        ({"dark": np.full((3, *SIZE), np.nan)}, "dark"),
        ({"dark": [True]}, "dark"),
        ({"intensities": [1.0, 2.0]}, "intensities"),
        ({"intensities": [0.0] * 9}, "intensities"),
        ({"intensities": "nowhere.txt"}, "nowhere"),
        ({"region": (0, 0, 99, 99)}, "region"),
        ({"region": (0, 0, 0, 5)}, "region"),
        ({"region": (0, 0, 5)}, "region"),
        ({"pattern": "{name"}, "pattern"),
        ({"pattern": "{other}.png"}, "pattern"),
        ({"bands": ["a", "b"]}, "bands"),
        ({"lights": np.zeros((9, 3))}, "lights"),
        ({"lights": np.ones((2, 3))}, "lights"),
        ({"lights": "nowhere.lp"}, "nowhere"),
        ({"images": "nowhere"}, "images"),
        ({"pitch_mm": -1.0}, "pitch_mm"),
        ({"board_reflectance": 0.0}, "board_reflectance"),
        ({"max_pixels": 10}, "max_pixels"),
    ],
    ids=lambda value: value if isinstance(value, str) else "+".join(value),
)
def test_options_that_make_no_sense(tmp_path: Path, options: dict[str, Any], word: str) -> None:
    with pytest.raises(ImpastoError, match=word):
        read_stack(session(tmp_path / "session"), **options)


def test_the_doctor_survives_every_poor_stack() -> None:
    """Any shape, any content: a diagnosis, never an exception."""
    rng = np.random.default_rng(4)
    lights = rng.normal(size=(40, 3))
    lights[:, 2] = np.abs(lights[:, 2])
    for _ in range(60):
        count, bands = int(rng.integers(1, 12)), int(rng.integers(1, 7))
        height, width = (int(n) for n in rng.integers(1, 30, 2))
        samples = rng.random((count, bands, height, width)).astype(np.float32)
        samples[rng.random(samples.shape) < rng.choice([0.0, 0.02, 0.5, 0.98])] = rng.choice(
            [0.0, np.nan, np.inf, -1.0, 1e30]
        )
        poor = Stack(
            samples,
            lights=lights[rng.integers(0, 40, count)] * rng.choice([1.0, -1.0]),
            saturation=rng.choice([None, 1.0, 0.5]),
            mask=rng.random((height, width)) < rng.choice([0.0, 0.1, 2.0]),
        )
        diagnosis = doctor.examine(poor)
        assert diagnosis.findings
        json.dumps(diagnosis.to_dict(), allow_nan=False)
