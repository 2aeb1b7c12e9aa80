"""``impasto session init`` and ``check``: what lies in a folder, what EXIF says, what is wrong."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import impasto
from impasto import ArgumentError
from impasto.cli import main
from impasto.io import Session, read_session, write_lights, write_session
from impasto.io.images import exif
from impasto.io.images.exif import Exif, read_exif
from impasto.io.session_toml import sha256_of
from impasto.session import check_session, find_session, longest_increasing, sequence
from impasto.session.filter_wheel import find_filter_wheel
from raw_files import mosaic_of, write_dng
from test_session_file import same

START = datetime(2024, 5, 6, 10, 0, 0)
NAMES = [f"DSC_{number:04}.jpg" for number in range(8)]
LIGHTS = [(0.6 * np.cos(a), 0.6 * np.sin(a), 0.8) for a in np.linspace(0, 5.5, len(NAMES))]


def photograph(
    path: Path,
    seconds: float = 0.0,
    *,
    exposure: float = 0.008,
    focal: float = 60.0,
    value: int = 100,
    size: tuple[int, int] = (24, 18),
) -> None:
    """A picture with the EXIF of a camera, written by Pillow: an independent writer."""
    path.parent.mkdir(exist_ok=True)
    image = Image.new("RGB", size, (value, value, value))
    exif = image.getexif()
    exif[271], exif[272] = "NIKON CORPORATION", "NIKON D750"
    inner = exif.get_ifd(0x8769)
    when = START + timedelta(seconds=seconds)
    inner[36867] = when.strftime("%Y:%m:%d %H:%M:%S")
    inner[37521] = f"{when.microsecond // 10000:02}"
    inner[33434], inner[33437], inner[34855] = exposure, 8.0, 200
    inner[37386], inner[41989] = focal, int(focal)
    image.save(path, exif=exif.tobytes())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Eight photographs, six seconds apart, with lights, dark frames, boards and a mask."""
    home = tmp_path / "altar"
    for number, name in enumerate(NAMES):
        photograph(home / name, 6.0 * number, value=60 + number)
        photograph(home / "white" / name, 300 + 6.0 * number, value=220)
    for name in ("dark_1.jpg", "dark_2.jpg"):
        photograph(home / name, 600, value=2)
    photograph(home / "mask.png", value=255)
    write_lights(home / "lamps.lp", LIGHTS, NAMES)
    return home


def codes(diagnosis: impasto.doctor.Diagnosis, *severities: str) -> list[str]:
    return [finding.code for finding in diagnosis.findings if finding.severity in severities]


def test_what_lies_in_a_folder_becomes_a_session(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["session", "init", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "8 photographs of 24 x 18 pixels, DSC_0000.jpg to DSC_0007.jpg" in out
    assert "missing  photographs.pitch_mm" in out
    assert "calibration" not in out  # nothing is missing
    session = read_session(folder)
    assert (session.title, session.camera, session.lights) == ("altar", "NIKON D750", "lamps.lp")
    assert (session.dark, session.white) == (("dark_1.jpg", "dark_2.jpg"), "white")
    assert session.mask == "mask.png"
    # 60 mm on film of 36 x 24 mm, by the diagonals: 60 / 43.267 * 30 pixels, to 0.1.
    assert session.focal_length_px == pytest.approx(60 / np.hypot(36, 24) * 30, abs=0.05)
    assert set(session.sha256) == {
        *NAMES, *(f"white/{name}" for name in NAMES), "dark_1.jpg", "dark_2.jpg", "mask.png",
        "lamps.lp",
    }  # fmt: skip
    expected = impasto.read_stack(
        folder / "lamps.lp",
        dark=[folder / "dark_1.jpg", folder / "dark_2.jpg"],
        white=folder / "white",
        mask=folder / "mask.png",
    )
    same(impasto.read_stack(folder / "session.toml"), expected)
    before = (folder / "session.toml").read_bytes()
    assert main(["session", "init", str(folder)]) == 1
    assert "not replaced" in capsys.readouterr().err
    assert (folder / "session.toml").read_bytes() == before
    assert main(["session", "check", str(folder)]) == 0
    found = check_session(folder)
    assert codes(found, "error", "warning") == []
    assert codes(found, "ok") == ["changed", "size", "camera", "exposure", "order"]


def test_two_balls_become_a_session_with_their_lights_or_with_the_command(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    home = Path(shutil.copytree(data / "two_balls", tmp_path / "dome"))
    made = find_session(home)
    assert made.complete
    assert made.session.images == "Objects"
    lamps = home / "light_directions.txt"
    expected = impasto.read_stack(lamps, images=home / "Objects")
    assert main(["session", "init", str(home)]) == 0
    same(impasto.read_stack(home), expected)
    (home / "session.toml").unlink()
    lamps.unlink()
    capsys.readouterr()
    assert main(["session", "init", str(home)]) == 4
    out = capsys.readouterr().out
    assert f"impasto calibrate lights {home} --out {home / 'lights.lp'}" in out
    assert "missing  lights: " in out
    with pytest.raises(ArgumentError, match="impasto calibrate lights"):
        impasto.read_stack(home)
    assert main(["session", "check", str(home)]) == 1


def test_a_folder_without_photographs_or_with_several_is_refused(folder: Path) -> None:
    empty = folder / "empty"
    empty.mkdir()
    assert main(["session", "init", str(empty)]) == 1
    assert not (empty / "session.toml").exists()
    home = folder.parent
    photograph(home / "another" / "a.jpg")
    with pytest.raises(ArgumentError, match=r"several folders of photographs \(altar, another\)"):
        find_session(home)
    with pytest.raises(ArgumentError, match="is not a folder"):
        find_session(folder / NAMES[0])


def test_several_light_files_are_left_to_the_person(folder: Path) -> None:
    shutil.copy(folder / "lamps.lp", folder / "other.lp")
    made = find_session(folder)
    assert not made.complete
    assert "several light files (lamps.lp, other.lp)" in made.missing[0]


def test_listed_photographs_that_are_not_there_are_said(folder: Path) -> None:
    """And what the light file needs repaired."""
    (folder / NAMES[6]).unlink()
    longer = [tuple(1.2 * v for v in light) for light in LIGHTS]
    rows = [f"{name} {x} {y} {z}\n" for name, (x, y, z) in zip(NAMES, longer, strict=True)]
    (folder / "lamps.lp").write_text(f"{len(rows)}\n{''.join(rows)}")
    made = find_session(folder)
    assert any("1 of 8 listed photographs not found" in line for line in made.missing)
    assert any("are not unit vectors" in line for line in made.found)
    assert made.complete
    assert NAMES[6] not in made.session.sha256


def test_files_of_a_filter_wheel_are_one_photograph(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Written as a person would, and read with the arguments that say the same."""
    home = tmp_path / "wheel"
    for number, name in enumerate(NAMES[:6]):
        for value, band in ((90, "blue"), (120, "red"), (150, "ir")):
            photograph(home / f"{Path(name).stem}_{band}.png", value=value + number)
    write_lights(home / "lamps.lp", LIGHTS[:6], NAMES[:6])
    assert main(["session", "init", str(home)]) == 0
    out = capsys.readouterr().out
    assert "6 photographs with a file for each band, {name}_{band}.png: red, blue, ir" in out
    found = impasto.read_stack(home)
    assert found.bands[:3] == ("red red", "red green", "red blue")  # colour pictures, here
    bands = ["red", "blue", "ir"]
    same(found, impasto.read_stack(home / "lamps.lp", pattern="{name}_{band}.png", bands=bands))
    assert len(read_session(home).sha256) == 19


@pytest.mark.parametrize(
    ("names", "bands"),
    [
        (["a_450nm.tif", "a_1050nm.tif", "b_450nm.tif", "b_1050nm.tif"], ("450nm", "1050nm")),
        (["1-f2.tif", "1-f1.tif", "2-f1.tif", "2-f2.tif"], ("f1", "f2")),
        (["1 g.png", "1 r.png", "1 b.png", "2 g.png", "2 r.png", "2 b.png"], ("r", "g", "b")),
        (["a_450.tif", "a_550.tif", "b_450.tif"], None),  # one is missing
        (["a_450.tif", "b_450.tif"], None),  # one band is none
        (["IMG_450.tif", "IMG_451.tif"], None),  # numbers of photographs
        (["a_red.tif", "a_blue.png", "b_red.tif", "b_blue.png"], None),
        (["saint_anna.tif", "saint_mary.tif"], None),
    ],
)
def test_bands_in_names(names: list[str], bands: tuple[str, ...] | None) -> None:
    found = find_filter_wheel([Path(name) for name in names])
    assert (None if found is None else found.bands) == bands


def test_names_of_paintings_are_no_calibration_frames(tmp_path: Path) -> None:
    """Listed photographs stay photographs; whole words alone name frames."""
    names = ["white_1.png", "white_2.png", "white_3.png", "blackboard.png"]
    for name in names:
        photograph(tmp_path / name)
    write_lights(tmp_path / "a.lp", LIGHTS[:4], names)
    session = find_session(tmp_path).session
    assert (session.white, session.dark) == (None, None)
    assert set(names) < set(session.sha256)


def test_the_picture_of_a_lens_among_photographs_is_named(folder: Path) -> None:
    """``calibrate lens`` writes it there; without a light file it counts as a photograph."""
    for path in folder.glob("*.lp"):
        path.unlink()
    before = find_session(folder)
    assert not [words for words in before.missing if "lens.png" in words]
    photograph(folder / "lens.png", 40.0)
    (folder / "lens.json").write_text("{}")
    found = find_session(folder)
    assert set(found.session.sha256) - set(before.session.sha256) == {"lens.png"}
    (words,) = [words for words in found.missing if words.startswith("lens.png")]
    assert str(folder / "calibration") in words


# --- what has changed


def started(folder: Path) -> Path:
    assert main(["session", "init", str(folder)]) == 0
    return folder / "session.toml"


def test_changed_missing_and_damaged_files_are_all_listed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = started(folder)
    photograph(folder / NAMES[1], 6.0, value=9)
    (folder / NAMES[2]).write_bytes((folder / NAMES[2]).read_bytes()[:-40])
    (folder / NAMES[3]).unlink()
    capsys.readouterr()
    assert main(["session", "check", str(path), "--json"]) == 3
    report = json.loads(capsys.readouterr().out)
    found = [(one["code"], one["message"]) for one in report["findings"]]
    said = {code: [text for key, text in found if key == code] for code, _ in found}
    assert len(said["changed"]) == 2
    assert NAMES[1] in said["changed"][0]
    assert [NAMES[3] in text for text in said["missing"]] == [True]
    assert [NAMES[2] in text for text in said["damaged"]] == [True]
    advice = [one["advice"] for one in report["findings"] if one["code"] == "changed"]
    assert sha256_of(folder / NAMES[1]) in advice[0]
    (folder / NAMES[2]).unlink()
    (folder / NAMES[1]).unlink()
    assert main(["session", "check", str(path)]) == 1  # missing, but nothing is damaged


def test_exchanged_photographs_are_named_together(folder: Path) -> None:
    path = started(folder)
    first, second, copied = (folder / NAMES[number] for number in (1, 4, 6))
    before = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(before)
    copied.write_bytes((folder / NAMES[0]).read_bytes())
    found = [one.message for one in check_session(path).findings if one.code == "changed"]
    for one, was in ((1, 4), (4, 1), (6, 0)):
        (message,) = [words for words in found if words.startswith(NAMES[one])]
        assert f"holds what was {NAMES[was]} when" in message


@pytest.mark.parametrize("what", ["photograph", "mask"])
def test_another_size_is_named(what: str, folder: Path) -> None:
    changed = folder / (NAMES[5] if what == "photograph" else "mask.png")
    photograph(changed, 30.0, size=(18, 24))
    started(folder)
    finding = check_session(folder)["size"]
    assert finding.severity == "error"
    assert changed.name in finding.message
    assert "18 x 24" in finding.message


def test_numbers_that_do_not_fit_the_photographs(folder: Path) -> None:
    path = started(folder)
    text = path.read_text()
    focal = next(line for line in text.splitlines() if line.startswith("focal_length_px"))
    text = text.replace(focal, "focal_length_px = 80.0")
    text = text.replace("# pitch_mm = 0.05", "pitch_mm = 10.0")
    path.write_text(text.replace("# size_mm = [300.0, 400.0]", "size_mm = [200.0, 190.0]"))
    found = check_session(path)
    assert codes(found, "warning") == ["focal-length", "painting-size"]
    path.write_text(path.read_text().replace('name = "NIKON D750"', 'name = "NIKON D850"'))
    assert "EXIF says 'NIKON D750'" in check_session(path).of("note")[0].message
    # 24 x 18 pixels of 10 mm.
    assert "240 x 180 mm" in found["painting-size"].message
    path.write_text(path.read_text().replace('file = "lamps.lp"', "# no lights"))
    assert codes(check_session(path), "error") == ["photographs"]


def test_filters_have_exposures_of_their_own(tmp_path: Path) -> None:
    """Each is compared with the same filter under other lights."""
    for number in range(5):
        for band, exposure in ((450, 0.1), (650, 0.02)):
            path = tmp_path / f"p{number}_{band}.tif"
            photograph(path, 20.0 * number + band / 100, exposure=exposure)
    write_lights(tmp_path / "a.lp", LIGHTS[:5], [f"p{number}.tif" for number in range(5)])
    session = Session(lights="a.lp", pattern="{name}_{band}.tif")
    write_session(tmp_path / "session.toml", session)
    found = check_session(tmp_path)
    assert codes(found, "warning", "error") == []
    assert found.shape == (5, 6, 18, 24)
    photograph(tmp_path / "p3_650.tif", 66.5, exposure=0.1)
    assert codes(check_session(tmp_path), "error") == ["exposure"]
    assert check_session(tmp_path)["exposure"].observations == (7,)


# --- exposure, order and time


def taken(seconds: Sequence[float], **changes: dict[int, Exif]) -> list[Exif]:
    exif = [
        Exif("D750", 60.0, 60.0, 0.008, 8.0, 200.0, START + timedelta(seconds=s)) for s in seconds
    ]
    for place, one in changes.get("at", {}).items():
        exif[place] = one
    return exif


def of(exif: Sequence[Exif], code: str) -> impasto.doctor.Finding:
    names = [str(number) for number in range(len(exif))]
    found = [f for f in sequence(names, exif, equalised=False) if f.code == code]
    assert len(found) == 1
    return found[0]


def test_exposures_are_compared_by_the_light_that_they_let_in() -> None:
    """1/125 s at f/8 and 1/60 s at f/11.3 are 1 : 1.04; twice the time alone is 2."""
    longer = Exif("D750", 60.0, 60.0, 0.016, 8.0, 200.0, START)
    found = of(taken(range(8), at={3: longer}), "exposure")
    assert (found.severity, found.observations) == ("error", (3,))
    assert found.numbers["relative"]["3"] == 2.0
    # Half the area of the aperture makes up for twice the time.
    same_light = Exif("D750", 60.0, 60.0, 0.016, 8.0 * 2**0.5, 200.0, START)
    assert of(taken(range(8), at={3: same_light}), "exposure").severity == "ok"
    # As cameras round 1/125 s.
    rounded = Exif("D750", 60.0, 60.0, 1 / 127, 8.0, 200.0, START)
    assert of(taken(range(8), at={3: rounded}), "exposure").severity == "ok"
    exif = taken(range(8), at={3: longer})
    notes = sequence([str(i) for i in range(8)], exif, equalised=True)
    assert [f.severity for f in notes if f.code == "exposure"] == ["note"]


def test_another_lens_is_named() -> None:
    other = Exif("D750", 50.0, 50.0, 0.008, 8.0, 200.0, START)
    found = of(taken(range(8), at={6: other}), "camera")
    assert (found.severity, found.observations) == ("error", (6,))
    assert "50.0 mm, the others with 60.0 mm" in found.message


@pytest.mark.parametrize(
    "seconds",
    [[0, 6, 12, 18, 24, 30, 36, 42], [0, 0, 0, 6, 6, 6, 12, 12]],
    ids=["one after the other", "several in a second"],
)
def test_photographs_in_order(seconds: list[float]) -> None:
    assert of(taken(seconds), "order").severity == "ok"
    assert len(sequence(NAMES, taken(seconds), equalised=False)) == 3  # no finding on the clock


@pytest.mark.parametrize(
    ("seconds", "code", "possible"),
    [
        ([0, 6, 12, 300, 24, 30, 36, 42], "order", [(3,)]),  # taken again at the end
        ([0, 6, 18, 12, 24, 30, 36, 42], "order", [(2,), (3,)]),  # names exchanged: either of them
        ([300, 6, 12, 18, 24, 30, 36, 42], "order", [(0,)]),
        ([0, 6, 12, 18, -3576, -3570, -3564, -3558], "clock", [(3, 4)]),
        ([0, 6, 12, 18, 4000, 4006, 4012, 4018], "clock", [(3, 4)]),
    ],
)
def test_photographs_out_of_order_and_jumps_of_the_clock(
    seconds: list[float], code: str, possible: list[tuple[int, ...]]
) -> None:
    found = of(taken(seconds), code)
    assert found.severity == "warning"
    assert found.observations in possible


def test_how_long_the_clock_was_set_back_and_how_long_a_pause_was() -> None:
    back = of(taken([0, 6, 12, 18, -3576, -3570, -3564, -3558]), "clock")
    assert "back 60 min between 3 and 4" in back.message  # 3594 s
    pause = of(taken([0, 6, 12, 18, 4000, 4006, 4012, 4018]), "clock")
    assert "a pause of 66 min between 3 and 4, usually 6 s" in pause.message  # 3982 s


def test_photographs_that_say_nothing() -> None:
    found = sequence(["a", "b"], [Exif(), Exif()], equalised=False)
    assert [finding.code for finding in found] == ["exif"]
    unknown = Exif("D750")
    assert [f.code for f in sequence(["a", "b"], [unknown, unknown], equalised=False)] == ["camera"]


def test_a_check_finds_exposure_and_order_in_the_files(folder: Path) -> None:
    photograph(folder / NAMES[2], 900.0, exposure=0.004)
    path = started(folder)
    text = path.read_text()
    path.write_text(text.replace('white = "white"', "# no board"))
    found = check_session(path)
    assert codes(found, "error") == ["exposure"]
    assert codes(found, "warning") == ["order"]
    assert found["order"].observations == found["exposure"].observations == (2,)
    assert main(["session", "check", str(path)]) == 1
    # Boards of each light, taken with the same exposures, make up for them.
    path.write_text(text)
    assert check_session(path)["exposure"].severity == "note"


@given(st.lists(st.integers(0, 9), max_size=9))
def test_a_longest_increasing_subsequence(values: list[int]) -> None:
    """Against all subsequences of up to nine numbers."""
    found = [values[place] for place in longest_increasing(values)]
    longest = max(
        size
        for size in range(len(values) + 1)
        for some in itertools.combinations(values, size)
        if all(a < b for a, b in itertools.pairwise(some))
    )
    assert all(a < b for a, b in itertools.pairwise(found))
    assert len(found) == longest


# --- EXIF


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_exif_of_every_kind_of_file(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    photograph(path, 1.25)
    found = read_exif(path)
    when = START + timedelta(seconds=1.25)
    assert found == Exif("NIKON D750", 60.0, 60.0, 0.008, 8.0, 200.0, when)


def test_damaged_exif_is_no_error(tmp_path: Path) -> None:
    """Any 300 changes of the block: the pixels are not affected."""
    path = tmp_path / "a.jpg"
    photograph(path)
    good = path.read_bytes()
    start = good.index(b"Exif\0\0")
    chance = np.random.default_rng(3)
    seen = set()
    for _ in range(300):
        data = bytearray(good)
        for _ in range(chance.integers(1, 6)):
            data[start + chance.integers(200)] = chance.integers(256)
        path.write_bytes(data)
        seen.add(read_exif(path).camera)
    assert {"NIKON D750", None} <= seen


def test_files_without_exif(tmp_path: Path) -> None:
    Image.new("L", (4, 4)).save(tmp_path / "a.jpg")
    assert read_exif(tmp_path / "a.jpg") == Exif()
    (tmp_path / "b.jpg").write_bytes(b"")
    assert read_exif(tmp_path / "b.jpg") == Exif()
    with pytest.raises(ArgumentError, match="cannot be read"):
        read_exif(tmp_path / "none.jpg")


def test_raw_files_state_their_exposure_with_and_without_tiff(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the tags of TIFF, and by LibRaw as of files that are none: numbers of single precision."""
    pytest.importorskip("rawpy")
    tags = [
        (33434, "2I", 1, (1, 60), True),
        (33437, "2I", 1, (56, 10), True),
        (37386, "2I", 1, (105, 1), True),
    ]
    write_dng(tmp_path / "a.dng", mosaic_of(np.full((3, 64, 64), 0.3)), more=tags)
    stated = read_exif(tmp_path / "a.dng")
    assert (stated.exposure_s, stated.f_number, stated.focal_length_mm) == (1 / 60, 5.6, 105.0)
    monkeypatch.setattr(exif, "_block", lambda file: None)
    of_libraw = read_exif(tmp_path / "a.dng")
    assert of_libraw.exposure_s == pytest.approx(1 / 60, rel=1e-6)
    assert of_libraw.f_number == pytest.approx(5.6, rel=1e-6)
    assert of_libraw.taken is None
    write_dng(tmp_path / "b.dng", mosaic_of(np.full((3, 64, 64), 0.3)))
    assert read_exif(tmp_path / "b.dng") == Exif()
