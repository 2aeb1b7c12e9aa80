"""``session.toml``: written and read back, the stack of its arguments, refused mistakes, jobs."""

from __future__ import annotations

import random
import re
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fuzz_mutations
import impasto
from impasto import ArgumentError, CorruptInputError, ImpastoError, PointLight, Rig, Stack
from impasto.cli import main
from impasto.io import Session, read_session, write_lights, write_session
from impasto.io.session_toml import KEYS, session_text, sha256_of
from impasto.io.session_toml.schema import TABLES
from test_io_stack import CODES8, CODES16, HEIGHT, LIGHTS, NAMES, WIDTH, save, session

PAGE = Path(__file__).resolve().parents[1] / "docs" / "session.md"
FILES = [f"{name}.png" for name in NAMES]
VECTORS = {name: tuple(light) for name, light in zip(FILES, LIGHTS.tolist(), strict=True)}


def same(one: Stack, two: Stack) -> None:
    """Every number of two stacks, bit for bit."""
    for name in ("samples", "mask", "saturation", "scale", "black"):
        a, b = getattr(one, name), getattr(two, name)
        assert (a is None) == (b is None), name
        if a is not None:
            assert (a.dtype, a.shape) == (b.dtype, b.shape), name
            assert a.tobytes() == b.tobytes(), name
    assert one.rig.lights == two.rig.lights
    assert one.rig.pitch_mm == two.rig.pitch_mm
    assert one.rig.views.tobytes() == two.rig.views.tobytes()
    for name in ("bands", "encoding", "names"):
        assert getattr(one, name) == getattr(two, name), name


def written(folder: Path, **values: Any) -> Path:
    """A session file beside the photographs of a folder."""
    path = folder / "session.toml"
    path.unlink(missing_ok=True)
    write_session(path, Session(**values))
    return path


def refused(path: Path, kind: type[ImpastoError] = ArgumentError, **options: Any) -> str:
    with pytest.raises(kind) as caught:
        impasto.read_stack(path, **options)
    return str(caught.value)


# --- the file

NAME = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0\r\n")).filter(
    str.strip
)
NUMBER = st.floats(1e-6, 1e6)
VECTOR = st.tuples(*3 * [st.floats(-1e6, 1e6)])
PER_BAND = NUMBER | st.lists(NUMBER, min_size=1, max_size=4).map(tuple)
VALUES = {
    "title": NAME, "size_mm": st.tuples(NUMBER, NUMBER), "camera": NAME, "focal_length_px": NUMBER,
    "images": NAME, "bands": st.lists(NAME, min_size=1, max_size=3).map(tuple), "mask": NAME,
    "pitch_mm": NUMBER, "region": st.tuples(*4 * [st.integers(1, 10**6)]), "strict": st.booleans(),
    "max_pixels": st.integers(1, 2**62), "saturation": PER_BAND, "white": NAME, "dark": PER_BAND,
    "positions_mm": st.dictionaries(NAME, VECTOR, min_size=1, max_size=3),
    "intensities": PER_BAND, "allow_outside": st.booleans(),
    "sha256": st.dictionaries(NAME, st.from_regex(r"[0-9a-f]{64}", fullmatch=True), max_size=3),
}  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(st.fixed_dictionaries({}, optional=VALUES))
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, values: dict[str, Any]
) -> None:
    """Also names with quotation marks, control characters and letters of any script."""
    path = tmp_path_factory.getbasetemp() / "round.toml"
    path.write_text(session_text(Session(**values)), encoding="utf-8", newline="")
    assert read_session(path) == Session(**values)


def test_the_text_is_toml_for_people() -> None:
    text = session_text(Session(title='A "B"', lights="a.lp", saturation=(1.0, 2.0)))
    assert tomllib.loads(text) == {
        "version": 1, "allow_outside": False, "painting": {"title": 'A "B"'}, "camera": {},
        "photographs": {"saturation": [1.0, 2.0], "strict": False}, "lights": {"file": "a.lp"},
        "calibration": {},
    }  # fmt: skip
    assert max(map(len, text.splitlines())) <= 100


def test_every_key_is_a_field_and_has_an_example_that_can_be_read(tmp_path: Path) -> None:
    """The examples in the comments of a new file are what a person edits."""
    assert {key.attribute for key in KEYS} == {f.name for f in fields(Session)} - {"path", "lines"}
    path = tmp_path / "session.toml"
    for key in KEYS:
        section, _, last = key.name.rpartition(".")
        line = key.example if key.name in TABLES else f"{last} = {key.example}"
        head = key.name if key.name in TABLES else section
        extra = "[lights.directions]\n" if key.name == "lights.views" else ""
        extra += '"photo1.jpg" = [0, 0, 1]\n' if extra else ""
        path.write_text(f"version = 1\n{extra}{f'[{head}]' if head else ''}\n{line}\n")
        value = getattr(read_session(path), key.attribute)
        assert value is not None
        assert f"# {line}" in session_text(Session()) or value is False


def test_the_page_lists_the_keys() -> None:
    rows = re.findall(r"^\| `([^`]+)` \| `(.*)` \| (.+) \|$", PAGE.read_text("utf-8"), re.M)
    assert rows == [(key.name, key.example, key.meaning) for key in KEYS]


def test_an_existing_file_is_not_replaced(tmp_path: Path) -> None:
    path = written(tmp_path)
    before = path.read_bytes()
    with pytest.raises(ArgumentError, match="not replaced"):
        write_session(path, Session(title="another"))
    assert path.read_bytes() == before
    for wrong in (float("nan"), float("inf"), -1.0, "wide"):
        with pytest.raises(ArgumentError, match=r"photographs.pitch_mm: expected a positive"):
            write_session(tmp_path / "other.toml", Session(pitch_mm=wrong))
    with pytest.raises(ArgumentError, match="found dict"):
        write_session(tmp_path / "other.toml", Session(dark={"a": 1}))
    assert not (tmp_path / "other.toml").exists()
    number = np.float32(0.1)  # 0.1 of single precision is another number
    write_session(tmp_path / "single.toml", Session(pitch_mm=number, max_pixels=np.int64(5)))
    assert read_session(tmp_path / "single.toml").pitch_mm == float(number)
    with pytest.raises(ArgumentError, match="rename that file"):
        write_session(tmp_path / "other.toml", Session(mask="a\udc80.png"))


# --- the stack

CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "curve": ({"encoding": "srgb"}, {"encoding": "srgb"}),
    "nothing": ({}, {}),
    "mask": ({"mask": "mask.png"}, {"mask": "mask.png"}),
    "saturation": ({"saturation": (250.0, 240.0, 230.0)}, {"saturation": [250, 240, 230]}),
    "level": ({"dark": 3.0, "encoding": "linear"}, {"dark": 3, "encoding": "linear"}),
    "level 0": ({"dark": 0.0, "encoding": "linear"}, {"dark": 0, "encoding": "linear"}),
    "level of bands": (
        {"dark": (0.0, 1.0, 2.0), "encoding": "linear"},
        {"dark": [0, 1, 2], "encoding": "linear"},
    ),
    "dark frame": ({"dark": "dark 1.png"}, {"dark": "dark 1.png"}),
    "dark frames": (
        {"dark": ("dark 1.png", "dark 2.png")}, {"dark": ["dark 1.png", "dark 2.png"]},
    ),
    "board": ({"white": "white 1.png"}, {"white": "white 1.png"}),
    "boards": (
        {"white": "boards", "board_reflectance": 0.9},
        {"white": "boards", "board_reflectance": 0.9},
    ),
    "strengths": ({"intensities": (1.0, 2, 3, 4, 5, 6)}, {"intensities": [1, 2, 3, 4, 5, 6]}),
    "strengths of bands": (
        {"intensities": tuple((1.0, 1.0 + i, 2.0) for i in range(6))},
        {"intensities": [[1, 1 + i, 2] for i in range(6)]},
    ),
    "strengths file": ({"intensities": "strengths.txt"}, {"intensities": "strengths.txt"}),
    "pitch": ({"pitch_mm": 0.25}, {"pitch_mm": 0.25}),
    "bands": ({"bands": ("a", "b", "c")}, {"bands": ["a", "b", "c"]}),
    "region": ({"region": (3, 4, 10, 11)}, {"region": (3, 4, 10, 11)}),
    "pattern": (
        {"pattern": "{name}_{band}.png", "images": "wheel", "bands": ("450", "550")},
        {"pattern": "{name}_{band}.png", "images": "wheel", "bands": ("450", "550")},
    ),
    "patterns": (
        {"pattern": ("{name}_450.png", "{name}_550.png"), "images": "wheel"},
        {"pattern": ["{name}_450.png", "{name}_550.png"], "images": "wheel"},
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def painting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs, ``dirs.lp`` and frames of every kind."""
    folder = tmp_path_factory.mktemp("painting")
    session(folder)
    mask = np.full((3, HEIGHT, WIDTH), 255, np.uint8)
    mask[:, :5] = 0
    save(folder / "mask.png", mask)
    for i in (1, 2):
        save(folder / f"dark {i}.png", np.full((3, HEIGHT, WIDTH), i, np.uint8))
        save(folder / f"white {i}.png", np.full((3, HEIGHT, WIDTH), 240 - i, np.uint8))
    for i, name in enumerate(NAMES):
        save(folder / "boards" / f"{name}.png", np.full((3, HEIGHT, WIDTH), 200 + i, np.uint8))
        for band, planes in zip((450, 550), CODES8[i], strict=False):
            save(folder / "wheel" / f"{name}_{band}.png", planes[None])
    (folder / "strengths.txt").write_text("\n".join("123456"))
    return folder


@pytest.fixture
def copy(painting: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(painting, tmp_path / "painting"))


@pytest.mark.parametrize("case", CASES)
def test_a_session_is_the_stack_of_its_arguments(
    case: str, painting: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names start from the file of the session; names in a call from the working directory."""
    values, arguments = CASES[case]
    path = written(painting, lights="dirs.lp", **values)
    found = impasto.read_stack(path)
    same(impasto.read_stack(painting), found)  # the folder has a session
    monkeypatch.chdir(painting)
    same(found, impasto.read_stack("dirs.lp", **arguments))
    assert path in found.sources


def test_a_layer_is_chosen_by_a_session(tmp_path: Path) -> None:
    import OpenEXR

    for name, planes in zip(NAMES, CODES16, strict=True):
        half = np.float16(planes / 65535)
        channels = {f"{layer}.{c}": half[i] for layer in ("a", "b") for i, c in enumerate("RGB")}
        channels |= {"b.R": half[2]}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(tmp_path / f"{name}.exr"))
    write_lights(tmp_path / "dirs.lp", LIGHTS, [f"{name}.exr" for name in NAMES])
    path = written(tmp_path, lights="dirs.lp", layer="b")
    same(impasto.read_stack(path), impasto.read_stack(tmp_path / "dirs.lp", layer="b"))


def test_lights_may_stand_in_the_session(copy: Path) -> None:
    """Paired by name, not by order; as a light file with the same numbers."""
    backwards = dict(reversed(VECTORS.items()))
    views = dict.fromkeys(backwards, (0.1, 0.0, 2.0))
    found = impasto.read_stack(written(copy, directions=backwards))
    expected = impasto.read_stack(copy / "dirs.lp").take(range(len(FILES))[::-1])
    same(found, expected)
    with_views = impasto.read_stack(written(copy, directions=backwards, views=views))
    rows = [",".join(map(repr, (name, *backwards[name], 0.1, 0.0, 2.0))) for name in backwards]
    (copy / "views.csv").write_text("\n".join(rows).replace("'", ""))
    same(with_views, impasto.read_stack(copy / "views.csv"))
    # Other directions for the same photographs keep their names.
    turned = impasto.read_stack(written(copy, directions=backwards), lights=Rig(LIGHTS[::-1]))
    assert turned.names == tuple(backwards)
    same(turned, expected)


def test_positions_are_near_lamps(copy: Path) -> None:
    places = {name: tuple(100.0 * v for v in light) for name, light in VECTORS.items()}
    found = impasto.read_stack(written(copy, positions_mm=places, pitch_mm=0.5))
    lamps = Rig([PointLight(place) for place in places.values()], pitch_mm=0.5)
    same(found, impasto.read_stack(copy / "dirs.lp", lights=lamps))


def test_an_argument_wins_over_the_session_and_the_notes_say_so(copy: Path) -> None:
    path = written(copy, lights="dirs.lp", encoding="srgb", pitch_mm=0.1, saturation=200.0)
    found = impasto.read_stack(path, encoding="2.2", pitch_mm=0.3)
    same(
        found,
        impasto.read_stack(copy / "dirs.lp", encoding="2.2", pitch_mm=0.3, saturation=200),
    )
    said = [note.message for note in found.notes if note.kind == "session"]
    assert sorted(said) == [
        "photographs.encoding is not used, since encoding= was given",
        "photographs.pitch_mm is not used, since pitch_mm= was given",
    ]
    rig = Rig(impasto.read_stack(copy / "dirs.lp", intensities=[1, 2, 3, 4, 5, 6]).rig)
    path = written(copy, lights="dirs.lp", intensities=(6.0, 5, 4, 3, 2, 1))
    refined = impasto.read_stack(path, lights=rig)
    assert refined.rig.intensities.tolist() == [1, 2, 3, 4, 5, 6]
    assert [n.message for n in refined.notes if n.kind == "session"] == [
        "lights.file is not used, since lights= was given",
        "lights.intensities is not used, since lights= was given",
    ]
    write_lights(copy / "other.lp", LIGHTS[::-1], FILES)
    other = impasto.read_stack(path, lights=copy / "other.lp")
    # A light file has no strengths: the session's stay.
    strengths = [6, 5, 4, 3, 2, 1]
    same(other, impasto.read_stack(copy / "other.lp", intensities=strengths))
    assert "lights.file is not used" in str(next(n for n in other.notes if n.kind == "session"))


def test_strict_and_the_size_limit_hold(copy: Path) -> None:
    (copy / "shot 3.png").unlink()
    path = written(copy, lights="dirs.lp", strict=True)
    assert "shot 3.png" in refused(path, CorruptInputError)
    path = written(copy, lights="dirs.lp", max_pixels=10)
    assert "max_pixels=10" in refused(path)


def test_the_icon_is_read_as_by_its_light_file(data: Path, tmp_path: Path) -> None:
    """72 photographs: ``session init`` loses and adds nothing."""
    folder = Path(shutil.copytree(data / "icon_rti", tmp_path / "icon"))
    assert main(["session", "init", str(folder)]) == 0
    session = read_session(folder)
    assert session.lights == "dirs.lp"
    assert len(session.sha256) == 73
    found = impasto.read_stack(folder / "session.toml")
    same(found, impasto.read_stack(folder / "dirs.lp"))
    assert found.shape == (72, 3, 395, 402)


# --- mistakes

MISTAKES = {
    'version = 1\n[photographs]\npich_mm = 1': "line 3: photographs.pich_mm: is no key of a "
    "session file; did you mean 'photographs.pitch_mm'?",
    'version = 1\n[camera]\npitch_mm = 1': "line 3: camera.pitch_mm: is no key of a session file; "
    "did you mean 'photographs.pitch_mm'?",
    'version = 1\nmask = "a.png"': "line 2: mask: is no key of a session file; did you mean "
    "'photographs.mask'?",
    'version = 1\n[phtographs]\nmask = "a"': "line 2: phtographs: is no key",
    'version = 1\nphotographs = 3': "line 2: photographs: is a section",
    'version = 1\n[photographs]\n\n# a\npitch_mm = -1': "line 5: photographs.pitch_mm: expected a "
    "positive length in mm, found -1",
    'version = 1\n[photographs]\npitch_mm = nan': "expected a positive length in mm, found nan",
    f'version = 1\n[photographs]\npitch_mm = 1{400 * "0"}': "expected a positive length in mm",
    'version = 1\n[photographs]\npitch_mm = true': "expected a positive length in mm, found True",
    'version = 1\n[photographs]\npitch_mm = 2024-01-02': "found 2024-01-02",
    'version = 1\n[photographs]\nstrict = 1': "expected true or false, found 1",
    'version = 1\n[photographs]\nregion = [0, 0, 1]': "expected [top, left, height, width]",
    'version = 1\n[photographs]\npattern = "{name}{x}"': "expected {name} and at most {band}",
    'version = 1\n[photographs]\npattern = "{name:99999999999}"': "expected {name} and at most",
    'version = 1\n[photographs]\nsaturation = []': "a list of one for each band, found []",
    'version = 1\n[painting]\nsize_mm = [1]': "line 3: painting.size_mm: expected [width, height]",
    'version = 1\n[lights]\nfile = "a.lp"\n[lights.directions]\na = [0, 0, 1]': "line 4: "
    "lights.directions: lights.file says where the lights are, too",
    'version = 1\n[lights.directions]\n"a.png" = [0, 0]': "line 3: lights.directions.a.png: "
    "expected [x, y, z], found [0, 0]",
    'version = 1\n[lights.directions]\na.png = [0, 0, 1]': "names of files stand in quotation",
    'version = 1\n[lights.directions]\na = [0, 0, 1]\n[lights.views]\nb = [0, 0, 1]': "'a' has a "
    "light or a view, but not both",
    'version = 1\n[lights.views]\na = [0, 0, 1]': "needs lights.directions",
    'version = 1\n[files]\n"a.png" = "12"': "line 3: files.a.png: expected the 64 hexadecimal",
    'version = 2': "version: expected 1, found 2; a later format needs a later impasto",
    '[painting]\ntitle = "a"': "has no version",
}  # fmt: skip


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_named_with_its_line_and_key(text: str, tmp_path: Path) -> None:
    path = tmp_path / "session.toml"
    path.write_text(text)
    with pytest.raises(ArgumentError) as caught:
        read_session(path)
    assert MISTAKES[text] in str(caught.value)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    "content",
    [b"version = 1\n[painting\n", b"\xff\xfea\0", b"a = 1\na = 1", b"a = " + b"[" * 9000],
    ids=["bracket", "utf-16", "twice", "deep"],
)  # fmt: skip
def test_what_is_no_toml_is_damaged(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "session.toml"
    path.write_bytes(content)
    with pytest.raises(CorruptInputError, match=re.escape(str(path))):
        read_session(path)


def test_wrong_values_are_said_with_their_place(copy: Path) -> None:
    """Errors that only the photographs show, too."""
    path = written(copy, lights="dirs.lp", mask="boards/shot 1.png", bands=("a", "b"))
    line = path.read_text().splitlines().index('bands = ["a", "b"]') + 1
    assert f"{path}, line {line}: photographs.bands: 2 names for 3 bands" in refused(path)
    path = written(copy, lights="dirs.lp", intensities=(1.0, 2.0))
    assert "lights.intensities: expected one row for each of 6 lights" in refused(path)
    path = written(copy, lights="dirs.lp", encoding="bright")
    assert 'photographs.encoding: expected "linear"' in refused(path)
    path = written(copy, lights="dirs.lp", board_reflectance=0.5)
    assert "calibration.board_reflectance: needs photographs of the board" in refused(path)
    path = written(copy, lights="dirs.lp", mask="none.png")
    assert "photographs.mask" in refused(path)
    assert "does not exist" in refused(path)
    path = written(copy, lights="none.lp")
    assert "lights.file" in refused(path)
    assert "impasto calibrate lights" in refused(written(copy, title="no lights"))
    # What was given is not the session's fault.
    path = written(copy, lights="dirs.lp", mask="mask.png")
    assert refused(path, bands=["a", "b"]).startswith("bands: 2 names")


def outside(folder: Path) -> dict[str, Callable[[], dict[str, Any]]]:
    """Ways to lead out of a folder; each returns the values of a session."""
    other = folder.parent / "outside"

    def light_file() -> dict[str, Any]:
        write_lights(folder / "away.lp", LIGHTS, [f"../outside/{name}" for name in FILES])
        return {"lights": "away.lp"}

    def link_to_photograph() -> dict[str, Any]:
        (folder / FILES[2]).unlink()
        (folder / FILES[2]).symlink_to(other / FILES[2])
        return {"lights": "dirs.lp"}

    def link_to_folder() -> dict[str, Any]:
        (folder / "linked").symlink_to(other)
        return {"lights": "dirs.lp", "images": "linked"}

    def board() -> dict[str, Any]:
        (folder / "boards" / FILES[0]).unlink()
        (folder / "boards" / FILES[0]).symlink_to(other / FILES[0])
        return {"lights": "dirs.lp", "white": "boards"}

    def strengths() -> dict[str, Any]:
        (folder / "light_intensities.txt").symlink_to(other / "strengths.txt")
        return {"lights": "dirs.lp"}

    return {
        "parent": lambda: {"lights": "dirs.lp", "mask": "../outside/mask.png"},
        "absolute": lambda: {"lights": str(other / "dirs.lp")},
        "folder": lambda: {"lights": "dirs.lp", "images": "../outside"},
        "pattern": lambda: {"directions": VECTORS, "pattern": "../outside/{name}.png"},
        "hash": lambda: {"lights": "dirs.lp", "sha256": {"../outside/dirs.lp": 64 * "0"}},
        "light file": light_file, "link": link_to_photograph, "linked folder": link_to_folder,
        "linked board": board, "linked strengths": strengths,
    }  # fmt: skip


@pytest.mark.parametrize("way", list(outside(Path("a"))))
def test_files_stay_inside_the_folder_unless_the_session_says_otherwise(
    way: str, copy: Path
) -> None:
    shutil.copytree(copy, copy.parent / "outside")
    values = outside(copy)[way]()
    path = written(copy, **values)
    said = refused(path)
    assert "leads outside the folder of the session" in said
    assert "allow_outside = true" in said
    path = written(copy, allow_outside=True, **values)
    if way == "hash":
        assert "another file" in refused(path, CorruptInputError)
    else:
        assert impasto.read_stack(path).shape[0] == 6


def test_a_circle_of_links_is_refused(copy: Path) -> None:
    (copy / "a.png").symlink_to(copy / "b.png")
    (copy / "b.png").symlink_to(copy / "a.png")
    refused(written(copy, lights="dirs.lp", mask="a.png"))


# --- hashes


def test_another_file_is_refused_and_can_be_accepted(copy: Path) -> None:
    hashes = {name: sha256_of(copy / name) for name in [*FILES, "dirs.lp"]}
    path = written(copy, lights="dirs.lp", sha256=hashes)
    before = impasto.read_stack(path)
    same(before, impasto.read_stack(copy / "dirs.lp"))
    save(copy / FILES[1], CODES8[0])
    said = refused(path, CorruptInputError)
    assert said.startswith(f"{copy / FILES[1]}: is another file than when the session was written")
    assert re.search(r"session.toml, line \d+: files.shot 2.png has another SHA-256", said)
    assert main(["doctor", str(path)]) == 3
    assert main(["fit", str(path), "--out", str(copy / "fit"), "--quiet"]) == 3
    # The message says what to write where.
    digest = re.search(r'"([0-9a-f]{64})"', said)
    line = re.search(r"line (\d+)", said)
    assert digest
    assert line
    lines = path.read_text().splitlines()
    lines[int(line[1]) - 1] = f'"{FILES[1]}" = "{digest[1]}"'
    path.write_text("\n".join(lines))
    np.testing.assert_array_equal(impasto.read_stack(path).samples[1], before.samples[0])


def test_a_missing_file_is_refused_and_an_unlisted_one_noted(copy: Path) -> None:
    hashes = {name: sha256_of(copy / name) for name in FILES}
    path = written(copy, lights="dirs.lp", sha256=hashes | {"gone.png": 64 * "0"})
    assert "files.gone.png: is missing" in refused(path)
    del hashes[FILES[4]]
    notes = impasto.read_stack(written(copy, lights="dirs.lp", sha256=hashes)).notes
    assert any("1 photograph(s) have no hash in [files]: shot 5.png" in str(n) for n in notes)


def test_other_photographs_are_not_compared(copy: Path) -> None:
    other = Path(shutil.copytree(copy, copy.parent / "other"))
    save(other / FILES[1], CODES8[0])
    hashes = {name: sha256_of(copy / name) for name in FILES}
    path = written(copy, lights="dirs.lp", sha256=hashes)
    found = impasto.read_stack(path, images=other)
    same(found, impasto.read_stack(copy / "dirs.lp", images=other))
    assert any("hashes are not compared" in str(note) for note in found.notes)


# --- damage


def test_a_damaged_session_ends_in_words(tmp_path: Path) -> None:
    """500 changed files: a session, or an error of impasto; ``fuzz_readers.py`` reads more."""
    seeds = [
        session_text(Session(directions=VECTORS, pitch_mm=1.0, dark=1.0, region=(1, 2, 3, 4))),
        session_text(Session(lights="a.lp", sha256={"a": 64 * "1"}, pattern="{name}_{band}.tif")),
    ]
    path = tmp_path / "session.toml"
    outcomes = set()
    for number in range(500):
        chance = random.Random(number)
        data = fuzz_mutations.mutated([seed.encode() for seed in seeds], chance, text=True)
        path.write_bytes(data)
        try:
            read_session(path)
            outcomes.add("read")
        except ImpastoError as error:
            outcomes.add(type(error).__name__)
    assert outcomes == {"read", "ArgumentError", "CorruptInputError"}


# --- jobs and commands


@pytest.mark.parametrize("memory", ["1GiB", "100kB"])
def test_a_job_of_a_session_has_the_bits_of_the_fit(memory: str, copy: Path) -> None:
    """Read at once, and window by window: a pixel takes 294 bytes, all of them 176 kB."""
    pytest.importorskip("fcntl", reason="jobs need POSIX")
    hashes = {name: sha256_of(copy / name) for name in [*FILES, "mask.png"]}
    values = {"mask": "mask.png", "dark": "dark 1.png", "encoding": "2.2", "sha256": hashes}
    path = written(copy, positions_mm=VECTORS, pitch_mm=0.01, **values)
    out = impasto.run(
        path, copy / "job.zarr", memory=memory, tile=16, sample=1, threads=1, pooling="none"
    )
    expected = impasto.fit_sbrdf(impasto.read_stack(path), pooling="none", threads=1)
    found = impasto.load_sbrdf(out)
    for name, array in expected.arrays().items():
        assert array.tobytes() == found.arrays()[name].tobytes(), name
    again = impasto.ingest(path, copy / "all.stack.zarr", memory=memory, tile=16)
    same(impasto.read_stack(again), impasto.read_stack(path))
    assert impasto.jobs.verify(out) == ()
    save(copy / FILES[0], CODES8[1])
    assert [FILES[0] in str(finding) for finding in impasto.jobs.verify(out)] == [True]


def test_a_job_takes_no_region(copy: Path) -> None:
    pytest.importorskip("fcntl", reason="jobs need POSIX")
    path = written(copy, lights="dirs.lp", region=(0, 0, 8, 8))
    with pytest.raises(ArgumentError, match=r"photographs.region: a job fits the whole painting"):
        impasto.run(path, copy / "job.zarr", pooling="none")


def test_the_commands_take_a_session(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(copy, lights="dirs.lp", title="Annunciation", encoding="2.2")
    out = copy / "fit"
    words = ["fit", str(path), "--pooling", "none", "--no-check", "--out", str(out), "--quiet"]
    assert main(words) == 0
    found = impasto.load_sbrdf(out / "sbrdf.npz")
    expected = impasto.fit_sbrdf(
        impasto.read_stack(copy / "dirs.lp", encoding="2.2"), pooling="none"
    )
    np.testing.assert_array_equal(found.normal, expected.normal)
    capsys.readouterr()
    assert main(["info", str(path)]) == 0
    assert re.search(r"painting.title +Annunciation", capsys.readouterr().out)
    assert main(["doctor", str(copy)]) in {0, 1}
    assert "6 photographs" in capsys.readouterr().out
    path.write_text(path.read_text().replace("[camera]", "[camera]\nmodel = 1"))
    for command in (["doctor"], ["session", "check"], ["info"]):
        assert main([*command, str(path)]) == 1
        assert "camera.model: is no key" in capsys.readouterr().err


def test_a_session_can_be_changed_in_python(copy: Path) -> None:
    path = written(copy, lights="dirs.lp")
    changed = replace(read_session(path), encoding="linear")
    write_session(copy / "linear.toml", changed)
    assert impasto.read_stack(copy / "linear.toml").encoding.curve == "linear"
