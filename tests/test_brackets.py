"""Exposure brackets: the merged photograph against plain numpy, sessions, plans and captures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import captures
import impasto
from impasto import ArgumentError
from impasto.bracket import merge_exposures
from impasto.capture import plan_shots, read_shots, write_shots
from impasto.capture.drivers.faults import Faults
from impasto.capture.drivers.simulated import EXPOSURE_S
from impasto.capture.to_session import session_of
from impasto.cli import main
from impasto.io import Session, read_session, write_session, write_tiff16, write_tiff32
from impasto.jobs.photographs import open_photographs
from impasto.lens import Lens
from impasto.session import check_session

READ, SHOT = 0.001, 0.005
TIMES = (0.002, 0.008, 0.032)
LAMPS = {"a": (0.0, 0.0, 1.0), "b": (0.6, 0.0, 0.8), "c": (0.0, 0.6, 0.8)}
BLACK = 0.02


def noisy(light: np.ndarray, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Codes of full scale 1 above the black, clipped there; ``light`` is that of one second."""
    signal = light * seconds
    codes = signal + np.sqrt(READ**2 + SHOT**2 * signal) * rng.standard_normal(light.shape) + BLACK
    return np.asarray(np.clip(codes, 0.0, 1.0))


def least_squares(codes: list[float], black: float) -> float:
    """One sample by numpy's solver: lines s = x t through 0, rows over their deviations.

    The deviations are those of the light by the sum of the codes over the sum of the times.
    """
    whole = [(c - black, t) for c, t in zip(codes, TIMES, strict=True) if c < 1.0]
    if not whole:
        return 1.0
    signal, time = np.array(whole).T
    light = max(signal.sum(), 0.0) / time.sum()
    sigma = np.sqrt(READ**2 + SHOT**2 * light * time)
    (x,), *_ = np.linalg.lstsq((time / sigma)[:, None], signal / sigma, rcond=None)
    return float(black + x * TIMES[0])


def test_the_merged_photograph_is_that_of_weighted_least_squares() -> None:
    """Sample by sample; float32 has 24 bits, and the codes are below 1: a few units of 6e-8."""
    rng = np.random.default_rng(1)
    light = np.exp(rng.uniform(np.log(0.5), np.log(900.0), (3, 8, 9)))
    frames = [noisy(light, t, rng).astype(np.float32) for t in TIMES]
    found = merge_exposures(frames, TIMES, black=BLACK)
    assert found.dtype == np.float32
    expected = np.array([
        least_squares([float(one[place]) for one in frames], float(np.float32(BLACK)))
        for place in np.ndindex(light.shape)
    ]).reshape(light.shape)  # fmt: skip
    np.testing.assert_allclose(found, expected, atol=3e-7)
    clipped = np.minimum.reduce(frames) >= 1.0
    assert 0.02 < clipped.mean() < 0.3
    assert (found[clipped] == 1.0).all()
    assert (found[~clipped] < 1.0).all()


@pytest.mark.parametrize("light", [2.0, 20.0, 90.0])
def test_no_unbiased_estimate_has_less_noise(light: float) -> None:
    """The Cramer-Rao bound of Gaussian noise of known variance, without bias.

    Of 40 000 samples, a standard deviation is off by 0.35 % (1 / sqrt(2 n)), a mean by 0.5 % of it;
    both within four of these. Longer exposures than 1 / light clip, and count for nothing.
    """
    rng = np.random.default_rng(2)
    scene = np.full((1, 200, 200), light)
    found = merge_exposures([noisy(scene, t, rng) for t in TIMES], TIMES, black=BLACK)
    seconds = np.array([t for t in TIMES if light * t < 0.9])
    bound = 1.0 / np.sqrt((seconds**2 / (READ**2 + SHOT**2 * light * seconds)).sum())
    error = (found - BLACK) / TIMES[0] - light
    assert float(error.std()) == pytest.approx(bound, rel=0.014)
    assert abs(float(error.mean())) < 0.02 * bound


@pytest.mark.parametrize(
    ("frames", "times", "options", "said"),
    [
        ([np.ones((1, 2, 2))], (0.1, 0.2), {}, "seconds: expected one of each exposure, found 2"),
        ([np.ones((1, 2, 2)), np.ones((1, 2, 3))], (1, 2), {}, r"shapes \(1, 2, 2\) and \(1, 2, 3"),
        ([np.ones((1, 2, 2))], (0.0,), {}, "seconds: expected a positive number"),
        ([np.ones((1, 2, 2))], (1.0,), {"read_noise": 0.0}, "read_noise: expected a positive"),
    ],
)
def test_brackets_that_are_none(
    frames: list[np.ndarray], times: tuple[float, ...], options: dict[str, float], said: str
) -> None:
    with pytest.raises(ArgumentError, match=said):
        merge_exposures(frames, times, **options)


# --- sessions


def frame(name: str, number: int) -> str:
    return f"{name}-{number}.tif"


def brackets() -> dict[str, tuple[tuple[str, float], ...]]:
    return {
        frame(name, 1): tuple((frame(name, n), t) for n, t in enumerate(TIMES, 1)) for name in LAMPS
    }


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """Three lamps with three exposures each, 16 bits, and two dark frames."""
    rng = np.random.default_rng(3)
    for folder in ("photos", "dark", "files", "black"):
        (tmp_path / folder).mkdir()
    for name in LAMPS:
        light = np.exp(rng.uniform(np.log(2.0), np.log(700.0), (3, 30, 40)))
        for number, seconds in enumerate(TIMES, 1):
            write_tiff16(tmp_path / "photos" / frame(name, number), noisy(light, seconds, rng))
    for number in (1, 2):
        dark = BLACK + READ * rng.standard_normal((3, 30, 40))
        write_tiff16(tmp_path / "dark" / f"dark{number}.tif", dark)
    return tmp_path


def written(home: Path, **values: Any) -> Path:
    path = home / "session.toml"
    path.unlink(missing_ok=True)
    usual = {
        "images": "photos", "dark": "dark", "brackets": brackets(),
        "directions": {frame(name, 1): light for name, light in LAMPS.items()},
    }  # fmt: skip
    write_session(path, Session(**{**usual, **values}))
    return path


def codes(path: Path) -> np.ndarray:
    import tifffile

    found = np.asarray(tifffile.imread(path))
    return found if found.shape[0] == 3 else np.moveaxis(found, -1, 0)


def merged(home: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """The photograph and the mean of the dark frames by plain numpy, full scale 1."""
    dark = np.mean([codes(one) / 65535.0 for one in sorted((home / "dark").iterdir())], axis=0)
    frames = [codes(home / "photos" / frame(name, n)) / 65535.0 for n in (1, 2, 3)]
    found = np.array([
        least_squares([float(one[place]) for one in frames], float(dark[place]))
        for place in np.ndindex(dark.shape)
    ])  # fmt: skip
    return found.reshape(dark.shape), dark


def test_a_session_reads_each_bracket_as_one_photograph(home: Path) -> None:
    """Against numpy, above the dark frames; clipped in all exposures: censored, +inf."""
    stack = impasto.read_stack(written(home))
    assert stack.shape == (3, 3, 30, 40)
    assert stack.names == tuple(frame(name, 1) for name in LAMPS)
    assert not [note for note in stack.notes if note.kind == "unlisted"]
    for name, found in zip(LAMPS, np.asarray(stack.samples), strict=True):
        photograph, dark = merged(home, name)
        clipped = photograph >= 1.0
        assert 0.01 < clipped.mean() < 0.3
        assert np.isposinf(found[clipped]).all()
        # Codes of 16 bits as float32, and a difference of two of them.
        np.testing.assert_allclose(found[~clipped], (photograph - dark)[~clipped], atol=5e-7)
    assert {path.name for path in stack.sources} >= {frame("a", n) for n in (1, 2, 3)}
    level = impasto.read_stack(written(home, dark=65535.0 * BLACK)).samples
    finite = np.isfinite(level) & np.isfinite(stack.samples)
    # The mean of two dark frames is off by its noise, 0.07 %, at 1e5 samples by five of these.
    apart = level[finite] - stack.samples[finite]
    assert float(np.abs(apart).max()) < 5 * READ / np.sqrt(2)
    assert finite.mean() > 0.7


def test_a_window_is_a_crop_also_in_a_job(home: Path) -> None:
    path = written(home)
    whole = impasto.read_stack(path)
    part = impasto.read_stack(path, region=(4, 6, 10, 12))
    np.testing.assert_array_equal(part.samples, whole.samples[..., 4:14, 6:18])
    opened = open_photographs(path, {}, 1, None)
    window = opened.window(slice(4, 14), slice(6, 18))
    np.testing.assert_array_equal(window.samples, whole.samples[..., 4:14, 6:18])
    assert check_session(path).usable


def test_brackets_are_merged_before_they_are_resampled(home: Path) -> None:
    """As a session whose files are the merged photographs.

    The mean of the dark frames is rounded elsewhere: to half of 6e-8 below 1, in two places.
    """
    camera = np.array([[60.0, 0.0, 19.5], [0.0, 60.0, 14.5], [0.0, 0.0, 1.0]])
    bent = np.array([-0.1, 0.02, 0.0, 0.0, 0.0])
    lens = Lens("radial", (40, 30), camera, bent, np.ones(4), np.zeros(5), 0.1, 9, 90)
    lens.save(home / "lens.json")
    found = impasto.read_stack(written(home, lens="lens.json"))
    plain = impasto.read_stack(written(home, dark=None, lens=None)).samples
    dark = np.mean([codes(one) / 65535.0 for one in sorted((home / "dark").iterdir())], axis=0)
    for name in LAMPS:
        frames = [codes(home / "photos" / frame(name, n)) / np.float32(65535.0) for n in (1, 2, 3)]
        one = merge_exposures(frames, TIMES, black=dark)
        write_tiff32(home / "files" / frame(name, 1), one)
    write_tiff32(home / "black" / "dark.tif", dark.astype(np.float32))
    expected = impasto.read_stack(written(
        home, images="files", dark="black", brackets=None, lens="lens.json", saturation=1.0
    ))  # fmt: skip
    np.testing.assert_allclose(found.samples, expected.samples, atol=1.2e-7)
    assert not np.array_equal(found.samples, plain)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('"a-1.tif" = [["a-1.tif", 0.002]]', 'expected two or more of ["file", seconds]'),
        ('"a-2.tif" = [["a-1.tif", 0.002], ["a-2.tif", 0.008]]', "as its shortest exposure"),
        ('"a-1.tif" = [["a-1.tif", 0.002], ["a-1.tif", 0.008]]', "a-1.tif is in brackets twice"),
        ('"a-1.tif" = [["a-1.tif", 0.002], ["a-2.tif", 0]]', "expected an exposure time"),
        ('"a-1.tif" = [["a-1.tif", 0.002], ["a-9.tif", 0.008]]', "a-9.tif does not exist"),
    ],
)
def test_a_wrong_bracket_is_named_with_its_line(home: Path, line: str, said: str) -> None:
    text = written(home, brackets=None).read_text()
    text = text.replace("# [photographs.brackets]", f"[photographs.brackets]\n{line}")
    (home / "session.toml").write_text(text)
    with pytest.raises(ArgumentError) as caught:
        impasto.read_stack(home)
    assert said in str(caught.value)
    assert "photographs.brackets" in str(caught.value)


# --- plans and captures


def test_a_plan_holds_brackets(tmp_path: Path) -> None:
    """Exposures are shots of their own, in one section of the file; darks have the longest."""
    plan = captures.plan(4, exposure_s=(0.008, 0.002), references=2)
    names = [shot.name for shot in plan.of("photograph")]
    assert names[:3] == ["shot_001-1", "shot_001-2", "shot_002-1"]
    assert [shot.exposure_s for shot in plan.of("photograph")][:2] == [0.002, 0.008]
    assert {shot.exposure_s for shot in plan.of("dark")} == {0.008}
    assert {shot.exposure_s for shot in plan.of("reference")} == {0.002}
    write_shots(tmp_path / "shots.toml", plan)
    text = (tmp_path / "shots.toml").read_text()
    assert text.count("exposure_s = [0.002, 0.008]") == 4
    assert read_shots(tmp_path / "shots.toml").shots == plan.shots
    for wrong, said in (
        ("[0.002]", "a list of two or more"),
        ("[0.002, 0.002]", "each must be 1.05 times the one before it"),
    ):
        (tmp_path / "shots.toml").write_text(text.replace("[0.002, 0.008]", wrong))
        with pytest.raises(ArgumentError, match=said):
            read_shots(tmp_path / "shots.toml")
    (tmp_path / "shots.toml").write_text(text.replace("= 0.008", "= [0.002, 0.008]"))
    with pytest.raises(ArgumentError, match="several exposures, which are for photographs"):
        read_shots(tmp_path / "shots.toml")
    with pytest.raises(ArgumentError, match="expected one exposure time or more"):
        plan_shots(captures.light_file(3), exposure_s=())


def test_a_capture_with_brackets_is_read_as_linear_photographs(tmp_path: Path) -> None:
    """Against the light of the simulated rig, which has no noise.

    A photograph of the shortest exposure has the noise of the sensor, which is 0.1 % and 0.5 %; of
    three, two of them 4 and 16 times as long, the deviation is that of the bound above, at most a
    third of it where none is clipped. What clips in the longest is whole in the shortest.
    """
    seconds = (EXPOSURE_S / 4, EXPOSURE_S, 4 * EXPOSURE_S)
    plan = captures.plan(6, exposure_s=seconds, darks=2, references=6)
    devices = captures.rig(plan)
    out = tmp_path / "out"
    result = captures.taken(plan, devices, out)
    assert result.complete
    assert len(list((out / "photographs").iterdir())) == 18
    session = read_session(out)
    assert session.brackets is not None
    assert session.intensities is None
    name = "shot_003-1.png"
    assert session.brackets[name] == tuple(
        (f"shot_003-{n}.png", t) for n, t in enumerate(seconds, 1)
    )
    stack = impasto.read_stack(out)
    assert stack.shape == (6, 3, *captures.SIZE)
    truth = np.stack([devices._light(lamp) for lamp in range(1, 7)])
    short = captures.plan(6, exposure_s=seconds[0], darks=2, references=0)
    rigs = captures.rig(short)
    captures.taken(short, rigs, tmp_path / "short")
    single = impasto.read_stack(tmp_path / "short")
    scale = float(np.median(single.samples / truth))
    whole = np.isfinite(stack.samples) & (4.0 * 0.5 * truth < 0.9)
    assert whole.mean() > 0.05
    error = (stack.samples / scale - truth)[whole].std()
    assert error < 0.4 * (single.samples / scale - truth)[whole].std()
    assert np.isfinite(stack.samples).mean() > 0.999
    assert main(["session", "check", str(out)]) == 0
    # A photograph of which one exposure is missing does not count.
    entries = {k: v for k, v in captures.log_of(out).entries.items() if k != "shot_003-2"}
    without = session_of(plan, entries, None)
    assert without.directions is not None
    assert len(without.directions) == 5
    assert name not in without.directions
    one = captures.plan(1, exposure_s=seconds, darks=0, references=0)
    rig = captures.rig(one, Faults(forever={2: "timeout"}))
    captures.taken(one, rig, tmp_path / "half")
    assert not (tmp_path / "half" / "session.toml").exists()
