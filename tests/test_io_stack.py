"""`read_stack`: folders of photographs become one linear stack, with every decision told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile

import impasto
from impasto import Encoding, PointLight, Rig, Stack
from impasto.io import write_lights, write_stack

RNG = np.random.default_rng(8)
COUNT, HEIGHT, WIDTH = 6, 20, 30
AZIMUTHS = np.linspace(0.0, 2 * np.pi, COUNT, endpoint=False)
LIGHTS = np.stack([0.6 * np.cos(AZIMUTHS), 0.6 * np.sin(AZIMUTHS), np.full(COUNT, 0.8)], axis=1)
CODES16 = RNG.integers(100, 65000, (COUNT, 3, HEIGHT, WIDTH), dtype=np.uint16)
CODES8 = (CODES16 >> 8).astype(np.uint8)
NAMES = [f"shot {i + 1}" for i in range(COUNT)]


def save(path: Path, planes: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True, parents=True)
    if path.suffix == ".exr":
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        names = "RGB" if len(planes) == 3 else "Y"
        channels = {c: np.ascontiguousarray(p) for c, p in zip(names, planes, strict=True)}
        OpenEXR.File(header, channels).write(str(path))
    elif path.suffix == ".tif":
        tifffile.imwrite(path, planes if len(planes) > 1 else planes[0], photometric="minisblack")
    else:
        cv2.imwrite(str(path), np.ascontiguousarray(np.moveaxis(planes[::-1], 0, -1)))


def session(
    folder: Path, codes: np.ndarray = CODES8, suffix: str = ".png", lights: np.ndarray = LIGHTS
) -> Path:
    """Photographs and ``dirs.lp`` in a folder; the path of the latter."""
    for name, planes in zip(NAMES, codes, strict=False):
        save(folder / f"{name}{suffix}", planes)
    write_lights(folder / "dirs.lp", lights, [f"{name}{suffix}" for name in NAMES])
    return folder / "dirs.lp"


def read_stack(path: Path, **options: Any) -> Stack:
    """As :func:`impasto.read_stack`, of linear photographs; an archive has its own curve."""
    if path.suffix != ".npz":
        options = {"encoding": "linear"} | options
    return impasto.read_stack(path, **options)


def kinds(stack: impasto.Stack) -> list[str]:
    return [note.kind for note in stack.notes]


@pytest.mark.parametrize(
    ("suffix", "codes"),
    [
        (".png", CODES8),
        (".png", CODES16),
        (".tif", CODES16),
        (".tif", CODES8),
        (".tif", (CODES16 / 65535).astype(np.float32)),
        (".exr", (CODES16 / 65535).astype(np.float32)),
        (".exr", (CODES16 / 65535).astype(np.float16)),
        (".png", CODES16[:, :1]),
    ],
    ids=["png8", "png16", "tiff16", "tiff8", "tiff float", "exr", "exr half", "grey"],
)
def test_linear_files_are_kept_as_they_are(tmp_path: Path, suffix: str, codes: np.ndarray) -> None:
    stack = read_stack(session(tmp_path, codes, suffix), strict=True)
    assert stack.samples.dtype == codes.dtype
    np.testing.assert_array_equal(stack.samples, codes)
    np.testing.assert_allclose(stack.rig.directions, LIGHTS, atol=1e-15)
    assert stack.names == tuple(f"{name}{suffix}" for name in NAMES)
    assert stack.notes == ()
    full = {"u": np.iinfo(codes.dtype).max if codes.dtype.kind == "u" else 1}.get("u", 1)
    assert stack.encoding == Encoding("linear", float(full))


def test_folder_finds_its_light_file(tmp_path: Path) -> None:
    session(tmp_path)
    stack = read_stack(tmp_path)
    assert kinds(stack) == ["lights"]
    np.testing.assert_array_equal(stack.samples, CODES8)
    (tmp_path / "other.lp").write_bytes((tmp_path / "dirs.lp").read_bytes())
    with pytest.raises(impasto.ArgumentError, match="several light files"):
        read_stack(tmp_path)
    assert read_stack(tmp_path, lights=tmp_path / "other.lp").shape == CODES8.shape


def test_folder_with_lights_as_array_or_rig(tmp_path: Path) -> None:
    session(tmp_path).unlink()
    with pytest.raises(impasto.ArgumentError, match="lights="):
        read_stack(tmp_path)
    for lights in (LIGHTS, Rig(LIGHTS)):
        stack = read_stack(tmp_path, lights=lights)
        np.testing.assert_allclose(stack.rig.directions, LIGHTS, atol=1e-15)
    with pytest.raises(impasto.ArgumentError, match="5 lights"):
        read_stack(tmp_path, lights=LIGHTS[:5])


def test_photographs_elsewhere(tmp_path: Path) -> None:
    path = session(tmp_path / "photos")
    moved = path.rename(tmp_path / "dirs.lp")
    with pytest.raises(impasto.ArgumentError, match="images="):
        read_stack(moved)
    stack = read_stack(moved, images=tmp_path / "photos", strict=True)
    np.testing.assert_array_equal(stack.samples, CODES8)


def test_order_is_by_number_not_by_letter(tmp_path: Path) -> None:
    for i in (10, 9, 2):
        save(tmp_path / f"shot{i}.png", np.full((3, 4, 4), i, np.uint8))
    stack = read_stack(tmp_path, lights=LIGHTS[:3])
    assert stack.samples[:, 0, 0, 0].tolist() == [2, 9, 10]


@pytest.mark.parametrize(
    ("written", "rule"),
    [
        ("H:\\icons\\RTI\\{name}.png", "ignoring the folders"),
        ("/home/someone/RTI/{name}.png", "ignoring the folders"),
        ("{name}.PNG", "ignoring the folders"),
        ("raw/{name}.CR2", "without its ending"),
        ("IMG_{number}.jpg", "by order alone"),
    ],
)
def test_foreign_names_are_matched_and_the_rule_told(
    tmp_path: Path, written: str, rule: str
) -> None:
    path = session(tmp_path)
    names = [written.format(name=name, number=2 * i + 100) for i, name in enumerate(NAMES)]
    write_lights(path, LIGHTS, names)
    stack = read_stack(path)
    np.testing.assert_array_equal(stack.samples, CODES8)
    assert kinds(stack) == ["match"]
    assert rule in str(stack.notes[0])
    with pytest.raises(impasto.CorruptInputError, match=rule):
        read_stack(path, strict=True)


def test_missing_photograph_is_left_out_and_told(tmp_path: Path) -> None:
    path = session(tmp_path)
    (tmp_path / "shot 3.png").unlink()
    stack = read_stack(path)
    keep = [0, 1, 3, 4, 5]
    np.testing.assert_array_equal(stack.samples, CODES8[keep])
    np.testing.assert_allclose(stack.rig.directions, LIGHTS[keep], atol=1e-15)
    assert kinds(stack) == ["missing"]
    assert "shot 3.png" in str(stack.notes[0])
    with pytest.raises(impasto.CorruptInputError, match=r"shot 3\.png"):
        read_stack(path, strict=True)


def test_unlisted_photograph_is_told(tmp_path: Path) -> None:
    path = session(tmp_path)
    save(tmp_path / "shot 7.png", CODES8[0])
    save(tmp_path / "white board.png", CODES8[0])
    stack = read_stack(path)
    assert kinds(stack) == ["unlisted"]
    assert "shot 7.png" in str(stack.notes[0])
    assert "white" not in str(stack.notes[0])


def test_two_files_for_one_name_are_refused(tmp_path: Path) -> None:
    path = session(tmp_path)
    save(tmp_path / "shot 1.tif", CODES8[0])
    write_lights(path, LIGHTS, NAMES)
    with pytest.raises(impasto.ArgumentError, match="keep only one"):
        read_stack(path)


def test_truncated_photograph_stops_the_reading(tmp_path: Path) -> None:
    path = session(tmp_path)
    victim = tmp_path / "shot 4.png"
    victim.write_bytes(victim.read_bytes()[:-30])
    with pytest.raises(impasto.CorruptInputError, match=r"shot 4\.png"):
        read_stack(path)


@pytest.mark.parametrize(
    ("odd", "what"),
    [
        (CODES8[0][:, :-1], "size"),
        (CODES16[0], "sample type"),
        (CODES8[0][:1], "number of bands"),
    ],
)
def test_photographs_that_differ_are_both_named(tmp_path: Path, odd: np.ndarray, what: str) -> None:
    path = session(tmp_path)
    save(tmp_path / "shot 5.png", odd)
    with pytest.raises(impasto.ArgumentError, match=what) as caught:
        read_stack(path)
    assert "shot 5.png" in str(caught.value)
    assert "shot 1.png" in str(caught.value)


@pytest.mark.parametrize("curve", ["srgb", "2.2"])
def test_coded_files_become_linear_and_back(tmp_path: Path, curve: str) -> None:
    stack = read_stack(session(tmp_path), encoding=curve)
    assert stack.samples.dtype == np.float32
    # Independent statement of the curves (IEC 61966-2-1 and a plain power), in float64.
    share = CODES8 / 255.0
    linear = (
        share**2.2
        if curve == "2.2"
        else np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    )
    # float32 powers: a few units in the last place.
    np.testing.assert_allclose(stack.samples, linear, rtol=2e-6, atol=1e-9)
    # Back to codes: float32 noise times the steepest slope of the curve (255 * 12.92 near 0).
    np.testing.assert_allclose(stack.encode(stack.samples), CODES8, atol=2e-3)


def test_saturation_level_follows_the_curve(tmp_path: Path) -> None:
    codes = CODES8.copy()
    codes[0, 0, 0, :3] = [249, 250, 255]
    path = session(tmp_path, codes)
    for curve in ("linear", "srgb", "2.2"):
        stack = read_stack(path, encoding=curve, saturation=[250, 255, 255])
        clipped = np.isinf(np.stack([stack.linear(i) for i in range(COUNT)]))
        np.testing.assert_array_equal(clipped[:, 0], codes[:, 0] >= 250)
        np.testing.assert_array_equal(clipped[:, 1:], codes[:, 1:] == 255)
    with pytest.raises(impasto.ArgumentError, match="saturation"):
        read_stack(path, saturation=[250, 255])
    for curve in ("linear", "srgb"):
        with pytest.raises(impasto.ArgumentError, match=r"at most 255, .* 8 bits, found 255, 300"):
            read_stack(path, encoding=curve, saturation=[255, 255, 300])
    never = read_stack(path, saturation=np.inf)
    assert not np.isinf(np.stack([never.linear(i) for i in range(COUNT)])).any()


def test_mask_from_file_and_array(tmp_path: Path) -> None:
    path = session(tmp_path)
    inside = np.zeros((HEIGHT, WIDTH), bool)
    inside[4:15, 3:20] = True
    save(tmp_path / "mask.png", np.repeat(inside[None].astype(np.uint8) * 255, 3, axis=0))
    for mask in (tmp_path / "mask.png", str(tmp_path / "mask.png"), inside):
        np.testing.assert_array_equal(read_stack(path, mask=mask).mask, inside)
    with pytest.raises(impasto.ArgumentError, match="mask"):
        read_stack(path, mask=inside[:5])
    with pytest.raises(impasto.ArgumentError, match="empty"):
        read_stack(path, mask=inside & False)


def test_region_is_a_crop(tmp_path: Path) -> None:
    path = session(tmp_path)
    stack = read_stack(path, region=(2, 5, 10, 12), mask=np.ones((HEIGHT, WIDTH)))
    np.testing.assert_array_equal(stack.samples, CODES8[:, :, 2:12, 5:17])
    assert stack.mask is not None
    assert stack.mask.shape == (10, 12)
    with pytest.raises(impasto.ArgumentError, match="region"):
        read_stack(path, region=(2, 5, 19, 12))


@pytest.mark.parametrize("suffix", [".tif", ".exr", ".png"])
def test_a_region_of_photographs_frames_and_board_is_that_of_the_whole(
    tmp_path: Path, suffix: str
) -> None:
    codes = CODES16 if suffix != ".exr" else (CODES16 / 65535).astype(np.float32)
    path = session(tmp_path / "photographs", codes, suffix)
    for name in ("dark", "mask", "board"):
        save(tmp_path / f"{name}{suffix}", codes[0] // 4 if name == "dark" else codes[1])
    frames = {name: tmp_path / f"{name}{suffix}" for name in ("dark", "mask")}
    frames["white"] = tmp_path / f"board{suffix}"
    whole = read_stack(path, **frames)
    part = read_stack(path, **frames, region=(3, 7, 11, 13))
    np.testing.assert_array_equal(part.samples, whole.samples[..., 3:14, 7:20])
    np.testing.assert_array_equal(part.mask, whole.mask[3:14, 7:20])
    assert part.names == whole.names


def test_region_moves_the_origin_of_point_lights(tmp_path: Path) -> None:
    session(tmp_path)
    rig = Rig([PointLight((10.0, 20.0, 300.0))] * COUNT, pitch_mm=0.5)
    stack = read_stack(tmp_path, lights=rig, region=(0, 0, 10, 10))
    # The crop's middle is pixel corner (5, 5); the picture's is (15, 10): 5 mm right, 2.5 mm down.
    assert stack.rig.lights[0].position == pytest.approx((15.0, 17.5, 300.0))


def test_lamps_shine_on_a_region_as_strongly_as_on_the_whole(tmp_path: Path) -> None:
    """Intensities are those at the origin: by the inverse square as much less as it is farther."""
    session(tmp_path)
    lamps = [PointLight((10.0, 20.0, 30.0), 0.5), PointLight((10.0, 20.0, 30.0), 0.5, False)]
    rig = Rig(lamps * (COUNT // 2), pitch_mm=0.5)
    lights = read_stack(tmp_path, lights=rig, region=(0, 0, 10, 10)).rig.lights
    nearer = (10.0**2 + 20.0**2 + 30.0**2) / (15.0**2 + 17.5**2 + 30.0**2)
    assert [light.intensity for light in lights[:2]] == pytest.approx([0.5 * nearer, 0.5])


def flat_field(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, Path]:
    """A scene seen through vignetting, fall-off and uneven lights; the truth, board and dark."""
    truth = RNG.uniform(0.05, 0.9, (COUNT, 3, HEIGHT, WIDTH))
    falloff = (
        RNG.uniform(0.3, 1.0, (COUNT, 1, HEIGHT, WIDTH)) * np.array([0.9, 0.7, 0.5])[:, None, None]
    )
    dark = RNG.integers(200, 300, (3, HEIGHT, WIDTH))
    photographs = np.rint(50000 * truth * falloff + dark).astype(np.uint16)
    # A perfectly white board in the plane reads light times cos(theta_w) = light times l_z.
    board = np.rint(50000 * falloff * LIGHTS[:, 2, None, None, None] + dark).astype(np.uint16)
    path = session(folder, photographs)
    for name, planes in zip(NAMES, board, strict=True):
        save(folder / "board" / f"{name}.png", planes)
    save(folder / "dark.png", dark.astype(np.uint16))
    return truth, board, dark.astype(np.uint16), path


def test_white_board_and_dark_frame_follow_equation_3(tmp_path: Path) -> None:
    truth, board, dark, path = flat_field(tmp_path)
    # Rounding of photograph and board, half a code each, over at least 50000 * 0.3 * 0.5 * 0.8.
    bound = 1.0 / (50000 * 0.3 * 0.5 * 0.8)
    for white, black in (
        (tmp_path / "board", tmp_path / "dark.png"),
        (board, dark),
        ([tmp_path / "board" / f"{name}.png" for name in NAMES], [tmp_path / "dark.png"] * 2),
    ):
        stack = read_stack(path, white=white, dark=black, strict=True)
        np.testing.assert_allclose(stack.samples, truth, rtol=0, atol=bound)
    half = read_stack(path, white=board, dark=dark, board_reflectance=0.5)
    np.testing.assert_allclose(half.samples, truth * 0.5, rtol=0, atol=bound)


def test_clipped_samples_are_inf_and_clipped_board_is_unknown(tmp_path: Path) -> None:
    _, board, dark, path = flat_field(tmp_path)
    photographs = read_stack(path).samples.copy()
    photographs[1, 2, 3, 4] = 65535
    board[2, 0, 5, 6] = 65535
    board[3, 0, 7, 8] = 0
    stack = read_stack(session(tmp_path, photographs), white=board, dark=dark)
    assert stack.samples[1, 2, 3, 4] == np.inf
    assert np.isnan(stack.samples[2, 0, 5, 6])
    assert np.isnan(stack.samples[3, 0, 7, 8])
    assert np.isfinite(stack.samples).sum() == stack.samples.size - 3


def test_one_board_for_all_keeps_the_lights_apart(tmp_path: Path) -> None:
    _, board, dark, path = flat_field(tmp_path)
    stack = read_stack(path, white=tmp_path / "board" / "shot 1.png", dark=dark)
    assert "white" in kinds(stack)
    expected = (stack_codes(tmp_path) - dark) / (board[0].astype(float) - dark)
    np.testing.assert_allclose(stack.samples, expected, rtol=3e-7)


def stack_codes(folder: Path) -> np.ndarray:
    return read_stack(folder / "dirs.lp").samples.astype(np.float64)


def test_board_cosine_is_per_pixel_for_near_lights(tmp_path: Path) -> None:
    session(tmp_path, CODES16)
    rig = Rig([PointLight((30.0, 0.0, 40.0))] * COUNT, pitch_mm=1.0)
    board = np.full((COUNT, 3, HEIGHT, WIDTH), 30000, np.uint16)
    stack = read_stack(tmp_path, lights=rig, white=board)
    x = np.arange(WIDTH) - (WIDTH - 1) / 2
    y = (HEIGHT - 1) / 2 - np.arange(HEIGHT)
    cosine = 40 / np.sqrt((30 - x[None]) ** 2 + y[:, None] ** 2 + 40.0**2)
    np.testing.assert_allclose(stack.samples, CODES16 / 30000 * cosine, rtol=1e-6)
    assert not any(light.falloff for light in stack.rig.lights)


def test_dark_level_and_frames_that_do_not_fit(tmp_path: Path) -> None:
    path = session(tmp_path, CODES16)
    stack = read_stack(path, dark=100)
    light = np.stack([stack.linear(index) for index in range(COUNT)])
    np.testing.assert_allclose(light, (CODES16 - 100.0) / 65535, rtol=0, atol=1e-7)
    with pytest.raises(impasto.ArgumentError, match="dark"):
        read_stack(path, dark=np.zeros((3, 5, 5)))
    with pytest.raises(impasto.ArgumentError, match="white"):
        read_stack(path, white=np.ones((4, 3, HEIGHT, WIDTH)))
    save(tmp_path / "small.png", CODES16[0][:, :5])
    with pytest.raises(impasto.ArgumentError, match=r"small\.png"):
        read_stack(path, dark=tmp_path / "small.png")


def test_light_intensities(tmp_path: Path) -> None:
    path = session(tmp_path, CODES16)
    strengths = np.linspace(0.5, 1.5, COUNT)
    np.testing.assert_allclose(read_stack(path, intensities=strengths).rig.intensities, strengths)
    np.savetxt(tmp_path / "light_intensities.txt", np.repeat(strengths[:, None], 3, axis=1))
    stack = read_stack(path)
    assert kinds(stack) == ["intensities"]
    np.testing.assert_allclose(stack.rig.intensities, strengths)
    np.testing.assert_array_equal(stack.samples, CODES16)
    np.testing.assert_allclose(read_stack(path, intensities=1.0).rig.intensities, 1.0)
    per_band = strengths[:, None] * [1.0, 0.8, 0.6]
    stack = read_stack(path, intensities=per_band)
    np.testing.assert_allclose(stack.rig.intensities, 1.0)
    expected = CODES16 / 65535 / per_band[:, :, None, None]
    np.testing.assert_allclose(stack.samples, expected, rtol=1e-6)
    for wrong in (strengths[:3], -strengths, per_band[:, :2]):
        with pytest.raises(impasto.ArgumentError, match="intensities"):
            read_stack(path, intensities=wrong)
    (tmp_path / "wrong.txt").write_text("1 1 1\n\n1 1\n")
    with pytest.raises(impasto.CorruptInputError, match=r"3 in each; found in line 3: '1 1'$"):
        read_stack(path, intensities=tmp_path / "wrong.txt")
    with pytest.raises(impasto.CorruptInputError, match=r"lp: expected the strengths .*line 2: '"):
        read_stack(path, intensities=path)
    np.savetxt(tmp_path / "light_intensities.txt", strengths[:3])
    with pytest.raises(impasto.ArgumentError, match=r"found shape .3,. in .*light_intensities"):
        read_stack(path)


def six_bands(folder: Path, pattern: str, bands: list[str]) -> np.ndarray:
    codes = RNG.integers(0, 65536, (COUNT, len(bands), HEIGHT, WIDTH), dtype=np.uint16)
    for name, planes in zip(NAMES, codes, strict=True):
        for band, plane in zip(bands, planes, strict=True):
            save(folder / pattern.format(name=name, band=band), plane[None])
    write_lights(folder / "dirs.lp", LIGHTS, NAMES)
    return codes


@pytest.mark.parametrize("pattern", ["{name}_{band}.tif", "filter {band}/{name}.tif"])
def test_filter_wheel(tmp_path: Path, pattern: str) -> None:
    bands = ["420", "480", "530", "590", "640", "1000"]
    codes = six_bands(tmp_path, pattern, bands)
    stack = read_stack(tmp_path / "dirs.lp", pattern=pattern, strict=True)
    assert stack.bands == tuple(bands)
    np.testing.assert_array_equal(stack.samples, codes)
    some = read_stack(tmp_path / "dirs.lp", pattern=pattern, bands=["590", "420"])
    np.testing.assert_array_equal(some.samples, codes[:, [3, 0]])
    listed = read_stack(
        tmp_path / "dirs.lp",
        pattern=[pattern.replace("{band}", band) for band in bands],
        bands=[f"{band} nm" for band in bands],
    )
    assert listed.bands[0] == "420 nm"
    np.testing.assert_array_equal(listed.samples, codes)
    unnamed = read_stack(tmp_path, lights=LIGHTS, pattern=pattern)
    assert unnamed.names == tuple(NAMES)
    np.testing.assert_array_equal(unnamed.samples, codes)


def test_filter_wheel_with_a_colour_camera(tmp_path: Path) -> None:
    for name, planes in zip(NAMES, CODES16, strict=True):
        save(tmp_path / f"{name}_F1.png", planes)
        save(tmp_path / f"{name}_F2.png", planes // 2)
    stack = read_stack(tmp_path, lights=LIGHTS, pattern="{name}_{band}.png")
    assert stack.shape[1] == 6
    assert stack.bands[3] == "F2 red"
    np.testing.assert_array_equal(stack.samples[:, 3:], CODES16 // 2)


def test_filter_wheel_whose_bands_differ_in_type(tmp_path: Path) -> None:
    """8 bits beside 16 would be taken for 16 bits of next to no light."""
    for name, planes in zip(NAMES, CODES16, strict=True):
        save(tmp_path / f"{name}_F1.png", planes)
        save(tmp_path / f"{name}_F2.png", (planes // 256).astype(np.uint8))
    with pytest.raises(impasto.ArgumentError, match=r"in sample type: .*_F2\.png has uint8"):
        read_stack(tmp_path, lights=LIGHTS, pattern="{name}_{band}.png")


def test_filter_wheel_with_a_lost_file(tmp_path: Path) -> None:
    codes = six_bands(tmp_path, "{name}_{band}.tif", ["a", "b"])
    (tmp_path / "shot 2_b.tif").unlink()
    stack = read_stack(tmp_path / "dirs.lp", pattern="{name}_{band}.tif")
    np.testing.assert_array_equal(stack.samples, codes[[0, 2, 3, 4, 5]])
    assert "shot 2_b.tif" in str(stack.notes[0])
    for wrong in ("{band}.tif", "{name}_{filter}.tif", "{name}-{band}.tif", []):
        with pytest.raises(impasto.ArgumentError, match="pattern"):
            read_stack(tmp_path / "dirs.lp", pattern=wrong)


def test_an_archive_of_no_stack_is_refused(tmp_path: Path) -> None:
    stack = impasto.Stack(CODES8, lights=LIGHTS)
    swapped: Any = (stack, tmp_path / "s.npz")
    with pytest.raises(impasto.ArgumentError, match=r"^path: expected .* found Stack"):
        write_stack(*swapped)
    no_stack: Any = CODES8
    with pytest.raises(impasto.ArgumentError, match=r"^stack: expected .* found ndarray"):
        write_stack(tmp_path / "s.npz", no_stack)
    assert not list(tmp_path.iterdir())


def test_archive_round_trip(tmp_path: Path) -> None:
    rig = Rig([PointLight((1.0, 2.0, 300.0), 0.5, False)] * COUNT, pitch_mm=0.1)
    stack = impasto.Stack(
        CODES16,
        lights=rig,
        mask=CODES16[0, 0] > 1000,
        saturation=[60000, 60001, 60002],
        black=[1, 2, 3],
        encoding="2.2",
        names=NAMES,
        bands=["r", "g", "b"],
    )
    write_stack(tmp_path / "s.npz", stack)
    again = read_stack(tmp_path / "s.npz")
    for name in ("samples", "mask", "saturation", "black", "scale"):
        np.testing.assert_array_equal(getattr(again, name), getattr(stack, name))
    assert (again.rig.lights, again.rig.pitch_mm) == (rig.lights, 0.1)
    assert (again.names, again.bands, again.encoding) == (stack.names, stack.bands, stack.encoding)
    write_stack(tmp_path / "t.npz", stack)
    assert (tmp_path / "s.npz").read_bytes() == (tmp_path / "t.npz").read_bytes()
    np.savez(tmp_path / "min.npz", samples=CODES8, lights=LIGHTS)
    np.testing.assert_array_equal(read_stack(tmp_path / "min.npz").samples, CODES8)
    np.savez(tmp_path / "lost.npz", samples=CODES8)
    with pytest.raises(impasto.CorruptInputError, match="'lights'"):
        read_stack(tmp_path / "lost.npz")
    data = (tmp_path / "s.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(data[: len(data) // 2])
    with pytest.raises(impasto.CorruptInputError, match=r"cut\.npz"):
        read_stack(tmp_path / "cut.npz")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("encoding", "srgb"),
        # Said, though it is what is assumed where nobody says: these may be decoded sRGB.
        ("encoding", "linear"),
        ("encoding", Encoding("linear")),
        ("dark", 3),
        ("board_reflectance", 1.0),
    ],
)
def test_a_finished_stack_takes_no_option_of_photographs(
    tmp_path: Path, name: str, value: object
) -> None:
    np.savez(tmp_path / "s.npz", samples=CODES8, lights=LIGHTS)
    assert read_stack(tmp_path / "s.npz", strict=True).shape[0] == len(LIGHTS)
    with pytest.raises(impasto.ArgumentError, match=rf"^{name}: .*s\.npz holds a finished"):
        read_stack(tmp_path / "s.npz", **{name: value})


def test_a_board_that_no_photograph_shows_has_no_reflectance(tmp_path: Path) -> None:
    with pytest.raises(impasto.ArgumentError, match=r"^board_reflectance: .*\(white=\)"):
        read_stack(session(tmp_path), board_reflectance=0.9)


def test_paths_that_are_no_stack(tmp_path: Path) -> None:
    with pytest.raises(impasto.ArgumentError, match="does not exist"):
        read_stack(tmp_path / "nothing.lp")
    save(tmp_path / "one.png", CODES8[0])
    with pytest.raises(impasto.ArgumentError, match=r"one\.png"):
        read_stack(tmp_path / "one.png")
    with pytest.raises(impasto.ArgumentError, match="no light file"):
        read_stack(tmp_path)


def test_two_lights_can_be_read(tmp_path: Path) -> None:
    save(tmp_path / "a.png", CODES8[0])
    save(tmp_path / "b.png", CODES8[1])
    write_lights(tmp_path / "dirs.lp", LIGHTS[:2], ["a.png", "b.png"])
    assert read_stack(tmp_path / "dirs.lp").shape[0] == 2


def test_one_turned_photograph_is_told(tmp_path: Path) -> None:
    from test_io_images import jpeg

    for name, orientation in zip(NAMES, [1, 1, 6, 1, 1, 1], strict=True):
        jpeg(tmp_path / f"{name}.jpg", orientation=orientation)
    stack = read_stack(tmp_path, lights=LIGHTS)
    assert "orientation" in kinds(stack)
    np.testing.assert_array_equal(stack.samples[2], stack.samples[0])


@pytest.mark.parametrize(
    ("suffix", "encoding", "told"),
    [(".jpg", "linear", True), (".jpg", "srgb", False), (".png", "linear", False)],
)
def test_jpegs_taken_for_linear_light_are_told(
    tmp_path: Path, suffix: str, encoding: str, told: bool
) -> None:
    from test_io_images import jpeg

    for name, codes in zip(NAMES, CODES8, strict=True):
        path = tmp_path / f"{name}{suffix}"
        jpeg(path) if suffix == ".jpg" else save(path, codes)
    stack = read_stack(tmp_path, lights=LIGHTS, encoding=encoding, strict=True)
    assert ("JPEGs, read as linear light; most are sRGB" in str(stack.notes)) == told


def test_icon_reads_completely(data: Path) -> None:
    stack = read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb", strict=True)
    assert stack.shape == (72, 3, 395, 402)
    assert stack.notes == ()
    shown = stack.encode(stack.linear(0))
    assert float(shown.max()) <= 255.0


def test_every_file_that_was_read_is_listed(tmp_path: Path) -> None:
    lights = session(tmp_path)
    save(tmp_path / "aside" / "mask.png", CODES8[0])
    mask = tmp_path / "aside" / "mask.png"
    photographs = [tmp_path / f"{name}.png" for name in NAMES]
    stack = read_stack(lights, mask=mask)
    assert stack.sources == (lights, *photographs, mask)
    assert stack.take([1, 2]).sources == stack.sources
    write_stack(tmp_path / "a.npz", stack)
    assert read_stack(tmp_path / "a.npz").sources == (tmp_path / "a.npz",)
