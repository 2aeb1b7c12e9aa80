"""Light files: every variant met in practice, and every repair reported."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto.io import read_lights, write_lights

SQUARE = np.array([[0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [-0.6, 0.0, 0.8], [0.0, -0.6, 0.8]])
PLAIN = "4\na.jpg 0.6 0 0.8\nb.jpg 0 0.6 0.8\nc.jpg -0.6 0 0.8\nd.jpg 0 -0.6 0.8\n"
NAMES = ("a.jpg", "b.jpg", "c.jpg", "d.jpg")


def lp(folder: Path, text: str | bytes, name: str = "dirs.lp") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def kinds(file: impasto.io.LightFile) -> list[str]:
    return [note.kind for note in file.notes]


def test_plain_file_needs_no_repair(tmp_path: Path) -> None:
    file = read_lights(lp(tmp_path, PLAIN), strict=True)
    assert file.names == NAMES
    assert file.notes == ()
    np.testing.assert_allclose(file.directions, SQUARE, atol=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace("4\n", "4   \n"),
        PLAIN.replace("\n", "  \n"),
        PLAIN.replace(" ", "\t"),
        PLAIN.replace("\n", "\r\n"),
        PLAIN + "\n\n\n",
        "\ufeff" + PLAIN,
        PLAIN.replace(" ", " \t  "),
        PLAIN.rstrip("\n"),
    ],
    ids=[
        "blank after count",
        "blanks",
        "tabs",
        "CRLF",
        "empty lines",
        "BOM",
        "runs",
        "no last newline",
    ],
)
def test_harmless_variants(tmp_path: Path, text: str) -> None:
    file = read_lights(lp(tmp_path, text), strict=True)
    assert file.names == NAMES
    np.testing.assert_allclose(file.directions, SQUARE, atol=1e-15)


def test_utf16_and_latin1(tmp_path: Path) -> None:
    assert read_lights(lp(tmp_path, PLAIN.encode("utf-16"))).names == NAMES
    latin = PLAIN.replace("a.jpg", "été.jpg").encode("latin-1")
    assert read_lights(lp(tmp_path, latin)).names == ("été.jpg", *NAMES[1:])


def test_names_with_blanks_and_foreign_paths(tmp_path: Path) -> None:
    text = "2\nphoto of the  icon 1.jpg 0.6 0 0.8\nH:\\RTI shots\\icon\\2.jpg 0 0.6 0.8\n"
    file = read_lights(lp(tmp_path, text), strict=True)
    assert file.names == ("photo of the  icon 1.jpg", "H:\\RTI shots\\icon\\2.jpg")


@pytest.mark.parametrize("count", ["3", "5", "0"])
def test_wrong_count_uses_the_lines(tmp_path: Path, count: str) -> None:
    path = lp(tmp_path, count + PLAIN[1:])
    file = read_lights(path)
    assert len(file) == 4
    assert kinds(file) == ["count"]
    with pytest.raises(impasto.CorruptInputError, match=r"dirs\.lp.*says"):
        read_lights(path, strict=True)


def test_missing_count(tmp_path: Path) -> None:
    file = read_lights(lp(tmp_path, PLAIN[2:]))
    assert (len(file), kinds(file)) == (4, ["count"])


def test_lengths_are_normalised_and_told_beyond_one_percent(tmp_path: Path) -> None:
    within = PLAIN.replace("0.6 0 0.8", "0.604 0 0.804", 1)
    assert read_lights(lp(tmp_path, within), strict=True).notes == ()
    beyond = PLAIN.replace("0.6 0 0.8", "0.477 0 0.636", 1)
    file = read_lights(lp(tmp_path, beyond))
    assert kinds(file) == ["length"]
    assert "line 2 (a.jpg)" in str(file.notes[0])
    assert "0.795" in str(file.notes[0])
    np.testing.assert_allclose(np.linalg.norm(file.directions, axis=1), 1.0, atol=1e-15)
    assert file.lengths[0] == pytest.approx(0.795)


def test_positions_taken_for_directions_are_suspected(tmp_path: Path) -> None:
    file = read_lights(lp(tmp_path, "1\na.jpg 300 0 400\n"))
    assert "look like positions" in str(file.notes[0])


def test_decimal_commas_only_if_all_three_parse(tmp_path: Path) -> None:
    path = lp(tmp_path, "2\na.jpg 0,6 0 0,8\nb.jpg 0,0 0,6 0,8\n")
    file = read_lights(path)
    assert kinds(file) == ["comma"]
    np.testing.assert_allclose(file.directions, SQUARE[:2], atol=1e-15)
    with pytest.raises(impasto.CorruptInputError, match="line 2"):
        read_lights(lp(tmp_path, "1\na.jpg 0,6 0.0 0,8\n"))


def test_below_the_horizon_is_kept_and_told(tmp_path: Path) -> None:
    file = read_lights(lp(tmp_path, "2\na.jpg 0.8 0 -0.6\nb.jpg 0.6 0.8 -0.0\n"), strict=True)
    assert kinds(file) == ["horizon"]
    assert "1 light(s)" in str(file.notes[0])
    assert file.directions[0, 2] == pytest.approx(-0.6)


def test_more_than_a_thousand(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    lines = [f"{i}.jpg 0.6 0 0.8" for i in range(1001)]
    path = lp(tmp_path, "\n".join(["1001", *lines]))
    file = read_lights(path, strict=True)
    assert len(file) == 1001
    with caplog.at_level(logging.WARNING, "impasto.io"):
        write_lights(tmp_path / "out.lp", file)
    assert "relight reads at most 1000" in caplog.text


def test_repeated_name_is_told(tmp_path: Path) -> None:
    file = read_lights(lp(tmp_path, PLAIN.replace("b.jpg", "a.jpg")))
    assert kinds(file) == ["duplicate"]


def test_repairs_are_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "impasto.io"):
        read_lights(lp(tmp_path, "5" + PLAIN[1:]))
    assert "says 5 lights" in caplog.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("4\n", "no lights"),
        ("1\na.jpg 0.6 0.8\n", "line 2"),
        ("1\na.jpg 0.6 zero 0.8\n", "line 2"),
        ("1\na.jpg nan 0 0.8\n", "line 2"),
        ("1\na.jpg inf 0 0.8\n", "line 2"),
        ("1\na.jpg 0 0 0\n", "no length"),
        ("1\na.jpg 0 1e308 1e308\n", r"line 2 \(a\.jpg\).* too long"),
        ("2\na.jpg 0.6 0 0.8\n0.6 0 0.8\n", "only 1 of 2"),
    ],
)
def test_unreadable_lines_name_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(impasto.CorruptInputError, match=message) as caught:
        read_lights(lp(tmp_path, text))
    assert "dirs.lp" in str(caught.value)


def test_round_trip_is_exact(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    directions = impasto.Rig(rng.normal(size=(50, 3)) + np.array([0.0, 0.0, 3.0])).directions
    names = [f"shot number {i}.tif" for i in range(50)]
    write_lights(tmp_path / "out.lp", directions, names)
    file = read_lights(tmp_path / "out.lp", strict=True)
    assert file.names == tuple(names)
    # repr() round-trips float64, and normalising an already normalised vector may move the last
    # bit once: one unit in the last place of numbers below 1.
    np.testing.assert_allclose(file.directions, directions, rtol=0, atol=2.3e-16)
    write_lights(tmp_path / "again.lp", file)
    assert (tmp_path / "again.lp").read_text().count("\n") == 51


def test_write_refuses_names_it_could_not_read(tmp_path: Path) -> None:
    for names in (["a\nb"], [" a"], [""], ["a", "b"], None):
        with pytest.raises(impasto.ArgumentError, match="names"):
            write_lights(tmp_path / "x.lp", SQUARE[:1], names)
    assert list(tmp_path.iterdir()) == []


def test_text_by_row_and_by_column(tmp_path: Path) -> None:
    for table in (SQUARE, SQUARE.T):
        np.savetxt(tmp_path / "light_directions.txt", table)
        file = read_lights(tmp_path / "light_directions.txt", strict=True)
        np.testing.assert_allclose(file.directions, SQUARE, atol=1e-15)
        assert file.names is None
    (tmp_path / "lights.txt").write_text("4\n" + "\n".join(f"{x},{y},{z}" for x, y, z in SQUARE))
    np.testing.assert_allclose(read_lights(tmp_path / "lights.txt").directions, SQUARE, atol=1e-15)


def test_three_by_three_needs_a_hint(tmp_path: Path) -> None:
    path = tmp_path / "l.txt"
    np.savetxt(path, SQUARE[:3])
    with pytest.raises(impasto.ArgumentError, match="layout"):
        read_lights(path)
    np.testing.assert_allclose(read_lights(path, layout="rows").directions, SQUARE[:3], atol=1e-15)
    columns = read_lights(path, layout="columns").lengths
    np.testing.assert_allclose(columns, np.linalg.norm(SQUARE[:3], axis=0), atol=1e-15)


def test_text_of_other_shapes_is_refused(tmp_path: Path) -> None:
    for text in ("1 2\n3 4\n", "1 2 3\n4 5\n", "", "x y z\n"):
        with pytest.raises(impasto.CorruptInputError, match=r"l\.txt"):
            read_lights(lp(tmp_path, text, "l.txt"))


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("x,y,z\n0.6,0,0.8\n0,0.6,0.8\n", None),
        ("file,x,y,z\na.jpg,0.6,0,0.8\nb.jpg,0,0.6,0.8\n", ("a.jpg", "b.jpg")),
        ("a.jpg;0,6;0;0,8\nb.jpg;0;0,6;0,8\n", ("a.jpg", "b.jpg")),
        ('"a, the first.jpg",0.6,0,0.8\nb.jpg,0,0.6,0.8\n', ("a, the first.jpg", "b.jpg")),
    ],
)
def test_csv(tmp_path: Path, text: str, names: tuple[str, ...] | None) -> None:
    file = read_lights(lp(tmp_path, text, "lights.csv"))
    assert file.names == names
    np.testing.assert_allclose(file.directions, SQUARE[:2], atol=1e-15)


def test_dome_directions_and_positions(tmp_path: Path) -> None:
    path = tmp_path / "rig.dome"
    rows = [{"x": x, "y": y, "z": z} for x, y, z in SQUARE.tolist()]
    path.write_text(json.dumps({"lightConfiguration": "directional", "directions": rows}))
    np.testing.assert_allclose(read_lights(path).directions, SQUARE, atol=1e-15)
    content = {
        "lightConfiguration": "spherical",
        "directions": SQUARE.tolist(),
        "domeDiameter": 1000.0,
        "verticalOffset": 50.0,
        "imageWidth": 300.0,
    }
    path.write_text(json.dumps(content))
    file = read_lights(path)
    assert file.width_mm == 300.0
    # positionsSphere = direction * diameter / 2 + (0, 0, verticalOffset)
    np.testing.assert_allclose(file.positions, SQUARE * 500 + (0, 0, 50), atol=1e-12)
    assert all(isinstance(light, impasto.PointLight) for light in file.lights)
    path.write_text(json.dumps({"lightConfiguration": "lights3d", "positions3d": [[0, 0, 900]]}))
    file = read_lights(path)
    assert file.positions is None
    assert kinds(file) == ["position"]


def test_relight_project(tmp_path: Path) -> None:
    images = [
        {"filename": name, "direction": row}
        for name, row in zip(NAMES, SQUARE.tolist(), strict=True)
    ]
    images[1]["skip"] = True
    path = tmp_path / "icon.relight"
    path.write_text(json.dumps({"images": images, "folder": "shots", "pixelSize": 0.05}))
    file = read_lights(path)
    assert file.names == ("shots/a.jpg", "shots/c.jpg", "shots/d.jpg")
    assert file.pitch_mm == 0.05
    np.testing.assert_allclose(file.directions, SQUARE[[0, 2, 3]], atol=1e-15)


def test_alicevision(tmp_path: Path) -> None:
    lights = {
        name[0]: {"intensity": [1, 1, 1], "direction": row}
        for name, row in zip(NAMES, SQUARE.tolist(), strict=True)
    }
    path = tmp_path / "lights.json"
    path.write_text(json.dumps({"lights": lights}))
    file = read_lights(path, strict=True)
    assert (file.format, file.names) == ("alicevision", ("a", "b", "c", "d"))
    np.testing.assert_allclose(file.directions, SQUARE, atol=1e-15)


def test_broken_json_names_the_file(tmp_path: Path) -> None:
    for text in ("{", "[]", "{}", '{"images": []}', '{"directions": [[1, 2]]}', '{"lights": {}}'):
        with pytest.raises(impasto.CorruptInputError, match=r"rig\.dome"):
            read_lights(lp(tmp_path, text, "rig.dome"))


def test_unknown_kind_and_absent_file(tmp_path: Path) -> None:
    with pytest.raises(impasto.ArgumentError, match=r"lights\.xyz"):
        read_lights(lp(tmp_path, "1", "lights.xyz"))
    with pytest.raises(impasto.ArgumentError, match=r"none\.lp"):
        read_lights(tmp_path / "none.lp")


def test_real_light_files(data: Path) -> None:
    icon = read_lights(data / "icon_rti" / "dirs.lp", strict=True)
    assert len(icon) == 72
    assert round(icon.directions[:, 2].min(), 3) == 0.105
    balls = read_lights(data / "two_balls" / "light_directions.txt")
    assert len(balls) == 12
