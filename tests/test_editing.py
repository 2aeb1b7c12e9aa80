"""The page that edits marks, balls and meshes: who may reach it, what it writes, and a browser."""

from __future__ import annotations

import io
import json
import os
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import chromium
from impasto.align import read_depth, read_points, write_depth
from impasto.calibrate import read_balls
from impasto.cli import main
from impasto.depth_mesh import DepthMesh
from impasto.editing import BallOutlines, EditServer, Marks, Mesh, Subject
from impasto.editing.server import PAGE
from impasto.local_page import LARGEST
from loopback import fetched, request, running, serving

SIZE = (100.0, 75.0)
CORNERS = {
    "upper left": [8.0, 6.0], "upper right": [55.0, 6.5],
    "lower right": [55.5, 41.0], "lower left": [8.5, 40.0],
}  # fmt: skip


def served(subject: Subject) -> AbstractContextManager[EditServer]:
    return serving(EditServer(subject))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "photographs"
    folder.mkdir()
    random = np.random.default_rng(0)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), random.integers(0, 256, (48, 64), np.uint8))
    return folder


@pytest.fixture
def page(folder: Path) -> Iterator[EditServer]:
    with served(Marks(folder.parent / "points.json", folder, SIZE)) as server:
        yield server


def content(**changed: object) -> bytes:
    photographs = {"default": CORNERS}
    return json.dumps({"size_mm": SIZE, "photographs": photographs, **changed}).encode()


def test_the_address_needs_the_token(page: EditServer) -> None:
    own = f"/{page.token}/"
    assert request(page, own).status == 200
    assert request(page, f"{own}document.json").kind == "application/json"
    others = ["/", "/document.json", f"/{page.token}", f"/{page.token[:-1]}/", f"/{'x' * 32}/"]
    for path in [*others, f"/x/{page.token}/", f"/?{page.token}/"]:
        answer = request(page, path)
        assert (answer.status, answer.error[:16]) == (403, "open the address"), path
    posted = request(page, "/x/save", content())
    assert posted.status == 403
    # Two servers never share one, and nobody guesses 24 bytes.
    assert len(page.token) == 32


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "evil.example:{}", "[::1]:{}", None])
def test_the_host_must_be_the_server_s_own(page: EditServer, host: str | None) -> None:
    """A name of another site that was made to point at the loopback."""
    said = None if host is None else host.format(page.server_port)
    assert request(page, f"/{page.token}/document.json", Host=said).status == 403
    answer = request(page, f"/{page.token}/save", content(), Host=said, Origin=f"http://{said}")
    assert answer.status == 403
    assert not page.subject.file.path.exists()
    assert request(page, f"/{page.token}/", Host=f"localhost:{page.server_port}").status == 200


def test_it_listens_on_the_loopback_alone(page: EditServer) -> None:
    assert page.server_address[0] == "127.0.0.1"
    for name in (socket.gethostname(), "0.0.0.0"):
        try:
            other = socket.gethostbyname(name)
        except OSError:
            continue
        if not other.startswith(("127.", "0.")):
            with pytest.raises(OSError, match=r"."):
                socket.create_connection((other, page.server_port), timeout=5)


@pytest.mark.parametrize(
    "path",
    ["../server.py", "..%2fserver.py", "page.html", "../../../../../etc/passwd", "./editor.js",
     "editor.js/../page.html", "editor.js%00", "picture/-1", "picture/2", "picture/99999",
     "picture/0.png", "picture//0", "tile/0/9/0", "tile/0/0", "tile/0/0/0/../../../..", "save"],
)  # fmt: skip
def test_nothing_else_can_be_fetched(page: EditServer, path: str) -> None:
    answer = request(page, f"/{page.token}/{path}")
    assert (answer.status, answer.error) == (404, "there is nothing at this address")


def test_the_page_may_load_nothing_from_elsewhere(page: EditServer) -> None:
    answer = request(page, f"/{page.token}/")
    policy = answer.headers["Content-Security-Policy"].split("; ")
    assert "default-src 'none'" in policy
    assert all(word in {"'self'", "'none'"} for part in policy for word in part.split()[1:])
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Cache-Control"] == "no-store"
    for name in ("", *PAGE.names[1:]):
        text = request(page, f"/{page.token}/{name}").data.decode()
        assert "http://" not in text
        assert "https://" not in text


@pytest.mark.parametrize(
    ("body", "headers", "status"),
    [
        (content(), {"Origin": None}, 403),
        (content(), {"Origin": "http://evil.example"}, 403),
        (content(), {"Origin": "null"}, 403),
        (content(), {"Content_Type": "text/plain"}, 415),
        (content(), {"Content_Length": None}, 411),
        (content(), {"Content_Length": "-1"}, 411),
        (b"", {"Content_Length": str(LARGEST + 1)}, 413),
        (b"", {"Content_Length": "9" * 12}, 413),
        (b"{", {}, 400),
        (b"[]", {}, 400),
        (b"\xff\xfe", {}, 400),
        (b"[" * 100_000, {}, 400),
        (b'{"size_mm": 1' + b"0" * 5000 + b"}", {}, 400),
        (content(size_mm=[0, 1]), {}, 422),
        (content(size_mm=None), {}, 422),
        (content(more=1), {}, 422),
        (content(photographs={"default": {"upper left": [1, 2]}}), {}, 422),
        (content(photographs={"default": {**CORNERS, "upper left": [1, float("nan")]}}), {}, 400),
        (content().replace(b"8.0", b"1e999"), {}, 422),
        (content(more=1).replace(b": 1}", b": " + b"[" * 900 + b"]" * 900 + b"}"), {}, 422),
        (content(photographs={"c.png": CORNERS}), {}, 422),
        (content(photographs={"a.png": {**CORNERS, "upper left": [64.0, 2]}}), {}, 422),
    ],
)
def test_what_is_not_a_file_of_points_is_refused(
    page: EditServer, body: bytes, headers: dict[str, str], status: int
) -> None:
    path = page.subject.file.path
    answer = request(page, f"/{page.token}/save", body, **headers)
    assert (answer.status, answer.kind) == (status, "application/json")
    assert len(answer.error) > 10
    assert not path.exists()
    assert [one.name for one in path.parent.iterdir()] == ["photographs"]
    if status == 422 and b"c.png" in body:
        assert "points.json: not written: photographs: 'c.png' is not in" in answer.error


def test_a_save_replaces_the_file_by_what_the_reader_reads(page: EditServer) -> None:
    path = page.subject.file.path
    own = {name: [x + 1.0, y] for name, (x, y) in CORNERS.items()}
    for photographs in ({"default": CORNERS}, {"default": CORNERS, "b.png": own}):
        answer = request(page, f"/{page.token}/save", content(photographs=photographs))
        assert (answer.status, json.loads(answer.data)["said"]) == (
            200,
            "points.json written, 4 marks",
        )
        found = read_points(path)
        assert found.size_mm == SIZE
        assert {
            name: {k: list(v) for k, v in one.items()} for name, one in found.points.items()
        } == (photographs)
    # Another program's change is not lost.
    path.write_text(path.read_text().replace("9.0", "10.0"))
    answer = request(page, f"/{page.token}/save", content())
    assert (answer.status, "was changed by something else" in answer.error) == (422, True)
    assert read_points(path).points["b.png"]["upper left"] == (10.0, 6.0)


def test_pictures_and_tiles_are_the_photograph(folder: Path) -> None:
    """The tone in numpy: sRGB decoded, the 99.5th percentile white, and a gamma of 2.2."""
    codes = np.random.default_rng(1).integers(0, 256, (700, 2100), np.uint8)
    cv2.imwrite(str(folder / "a.png"), codes)
    shares = codes / 255.0
    light = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    grey = 255.0 * np.minimum(light / np.percentile(light, 99.5), 1.0) ** (1.0 / 2.2)
    with served(Marks(folder.parent / "points.json", folder, SIZE)) as server:
        own = f"/{server.token}"
        described = json.loads(request(server, f"{own}/document.json").data)["photographs"]
        assert described[0] == {"name": "a.png", "columns": 2100, "rows": 700}

        def fetched(path: str) -> np.ndarray:
            answer = request(server, f"{own}/{path}")
            assert (answer.status, answer.kind) == (200, "image/png")
            return np.asarray(Image.open(io.BytesIO(answer.data)), np.float64)

        # Rounded once, and in float32: half a code and a little.
        assert np.abs(fetched("tile/0/3/1") - grey[512:, 1536:2048]).max() < 0.51
        assert np.abs(fetched("tile/0/4/0") - grey[:512, 2048:]).max() < 0.51
        assert fetched("picture/0").shape == (683, 2048)
        assert fetched("picture/1").shape == (48, 64)


def marked(columns: int, rows: int, side: int, at: list[tuple[int, int]]) -> np.ndarray:
    """Markers 0 to 3 on white, blurred as light is; 16-bit files are linear."""
    picture = np.full((rows, columns), 60000.0)
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, (x, y) in enumerate(at):
        drawn = cv2.aruco.generateImageMarker(codes, number, side)
        picture[y : y + side, x : x + side] = np.where(drawn > 0, 60000.0, 2000.0)
    return np.rint(cv2.GaussianBlur(picture, (0, 0), 0.8)).astype(np.uint16)


def test_markers_are_found_and_copied_to_where_they_are_hidden(tmp_path: Path) -> None:
    """Edges of a marker that fills whole pixels lie half a pixel outside of their middles."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    at = [(20, 20), (240, 20), (240, 180), (20, 180)]
    whole = marked(320, 260, 60, at)
    hidden = whole.copy()
    hidden[:130] = 60000
    for name, picture in (("a.png", whole), ("b.png", hidden), ("c.png", whole)):
        cv2.imwrite(str(folder / name), picture)
    marks = Marks(tmp_path / "points.json", folder, (160.0, 100.0), "aruco:4x4_50")
    document = marks.document()
    assert document["points"].keys() == {"a.png", "b.png", "c.png"}
    touching = [(79.5, 79.5), (239.5, 79.5), (239.5, 179.5), (79.5, 179.5)]
    for own in document["points"].values():
        # Edges are found to a few hundredths of a pixel; a tenth is what an arrow key moves.
        assert np.abs(np.array(list(own.values())) - touching).max() < 0.1
    assert document["notes"] == {
        "b.png": "2 of 4 marks found; these are copied from a.png: check them"
    }
    sent = {key: document[key] for key in ("size_mm", "points_mm")}
    marks.save({**sent, "kind": document["mark_kind"], "photographs": document["points"]})
    words = ["align", str(folder), "--points", str(tmp_path / "points.json"), "--pixel", "1"]
    assert main([*words, "--out", str(tmp_path / "aligned"), "--quiet"]) == 0
    aligned = cv2.imread(str(tmp_path / "aligned" / "a.tif"), cv2.IMREAD_UNCHANGED)
    assert aligned.shape == (100, 160)


def discs(
    columns: int, rows: int, circles: list[tuple[float, float, float]], lamp: int
) -> np.ndarray:
    y, x = np.mgrid[:rows, :columns]
    picture = np.full((rows, columns), 150.0)
    for cx, cy, r in circles:
        edge = np.clip(r - np.hypot(x - cx, y - cy) + 0.5, 0.0, 1.0)
        picture += edge * (30.0 - picture)
        turn = 2.1 * lamp
        spot = np.hypot(x - cx - 0.4 * r * np.cos(turn), y - cy - 0.4 * r * np.sin(turn)) < 0.06 * r
        picture[spot] = 255.0
    return np.rint(picture).astype(np.uint8)


BALLS = [(70.0, 60.0, 40.0), (220.0, 90.0, 42.0)]


def test_balls_beside_the_painting_have_one_file(tmp_path: Path) -> None:
    for lamp in range(3):
        cv2.imwrite(str(tmp_path / f"{lamp}.png"), discs(300, 160, BALLS, lamp))
    subject = BallOutlines(tmp_path)
    # Anti-aliased edges of 8 bits: found to a tenth of a pixel.
    assert np.abs(np.array(subject.circles[0]) - BALLS).max() < 0.3
    moved = [[71.25, 60.5, 40.75], [219.0, 90.0, 43.0]]
    assert subject.save({"sets": [moved]}) == "circle_data.txt written"
    # Counted from 1, y up from the lower border.
    assert (tmp_path / "circle_data.txt").read_text() == (
        "72.250 99.500 40.750\n220.000 70.000 43.000\n"
    )
    read = read_balls(tmp_path, circles="circle_data.txt")
    for ball, (x, y, radius) in zip(read.balls, moved, strict=True):
        assert ball.outline is not None
        assert ball.corner is not None
        found = np.add(ball.outline.numbers, (*ball.corner, 0.0))
        assert np.abs(found - (x, y, radius)).max() < 1e-9
    words = ["calibrate", "lights", str(tmp_path), "--circles", "circle_data.txt", "--quiet"]
    assert main([*words, "--out", str(tmp_path / "lights.lp")]) == 0
    again = BallOutlines(tmp_path)
    assert np.abs(np.array(again.circles[0]) - moved).max() < 1e-9
    (tmp_path / "circle_data.txt").write_text("72 99 40\n10 70 43\n")
    assert main([*words, "--out", str(tmp_path / "other.lp")]) == 1


def test_each_folder_of_a_ball_has_its_own_file(tmp_path: Path) -> None:
    for name in ("ball1", "ball2"):
        (tmp_path / name).mkdir()
        for lamp in range(3):
            cv2.imwrite(str(tmp_path / name / f"{lamp}.png"), discs(140, 120, BALLS[:1], lamp))
    # As in the published data: each number on its own line.
    (tmp_path / "ball2" / "circle_data.txt").write_text("60\n50\n30\n\n")
    subject = BallOutlines(tmp_path)
    assert subject.circles[1] == [(59.0, 70.0, 30.0)]
    assert np.abs(np.array(subject.circles[0]) - BALLS[:1]).max() < 0.3
    said = subject.save({"sets": [[[70.0, 60.0, 40.0]], [[59.0, 70.0, 31.0]]]})
    assert said == "circle_data.txt written in 2 folders"
    outlines = [ball.outline for ball in read_balls(tmp_path, circles="circle_data.txt").balls]
    assert [None if o is None else o.numbers.tolist() for o in outlines] == [
        [70.0, 60.0, 40.0], [59.0, 70.0, 31.0]
    ]  # fmt: skip


@pytest.mark.parametrize(
    "sets",
    [None, [], [[]], [[[1, 2]]], [[[1, 2, "x"]]], [[[1, 2, -3]]], [[[1, 2, 1e308]]], [{}, {}]],
)
def test_circles_that_are_none_are_refused(tmp_path: Path, sets: object) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), discs(300, 160, BALLS, 0))
    (tmp_path / "circle_data.txt").write_text("71 100 40\n")
    with served(BallOutlines(tmp_path)) as server:
        answer = request(server, f"/{server.token}/save", json.dumps({"sets": sets}).encode())
    assert answer.status == 422
    assert (tmp_path / "circle_data.txt").read_text() == "71 100 40\n"


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    path = tmp_path / "aligned" / "report" / "depth.csv"
    path.parent.mkdir(parents=True)
    height = np.arange(12.0).reshape(3, 4) / 8.0
    write_depth(path, DepthMesh((30.0, 20.0), height, np.full((3, 4), 0.05)))
    return path


def test_heights_that_were_changed_have_no_known_error(mesh: Path) -> None:
    subject = Mesh(mesh)
    height = np.array(subject.document()["depth_mm"])
    height[1, 2] += 0.25
    assert subject.save({"depth_mm": height.tolist()}) == "depth.csv written, 1 height changed"
    found = read_depth(mesh)
    assert (found.depth_mm == height).all()
    unknown = np.zeros((3, 4), bool)
    unknown[1, 2] = True
    assert (np.isnan(found.sigma_mm) == unknown).all()
    assert (found.sigma_mm[~unknown] == 0.05).all()
    before = mesh.read_bytes()
    for bad in (None, [[1.0]], height[:2].tolist(), [["x"] * 4] * 3, [[float("inf")] * 4] * 3):
        sent = json.dumps({"depth_mm": bad}).replace("Infinity", "1e999").encode()
        with served(subject) as server:
            assert request(server, f"/{server.token}/save", sent).status == 422
    assert mesh.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("marks photographs --points p.json", "--size: p.json does not exist; a new file needs"),
        ("marks nowhere --points p.json --size 4x3", "nowhere is not a folder"),
        (
            "marks photographs --points p.json --size 4x3 --port 70000",
            "--port: expected 0 to 65535",
        ),
        (
            "marks photographs --points p.json --size 4x3 --markers charuco:5x4:9mm:6mm",
            "--markers:",
        ),
        ("balls nowhere", "nowhere is not a folder"),
        ("balls photographs --circles ../x.txt", "--circles: expected the name of a file"),
        ("mesh depth.csv", "depth.csv"),
    ],
)
def test_mistakes_are_named(
    words: str, said: str, folder: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder.parent)
    assert main(["edit", *words.split(), "--no-browser"]) == 1
    assert said in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_ends_the_command(folder: Path) -> None:
    words = ["edit", "marks", "photographs", "--points", "p.json", "--size", "4x3", "--no-browser"]
    with running(words, folder.parent) as url:
        assert fetched(url).startswith(b"<!doctype html>")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    chromium.needed()
    with chromium.Chromium(tmp_path_factory.mktemp("browser")) as one:
        yield one


def test_marks_are_moved_by_keys_and_by_the_mouse(browser: chromium.Chromium, folder: Path) -> None:
    path = folder.parent / "points.json"
    path.write_text(content().decode())
    with served(Marks(path, folder)) as server:
        browser.open(server.url)
        assert browser.value("document.getElementById('save').disabled")
        browser.key("ArrowRight", shift=True)
        browser.key("ArrowUp")
        browser.key("n")
        # What is fitted into the view: 64 columns and 48 rows, with 28 pixels on each side.
        box = browser.value(
            "(() => { const b = document.getElementById('view').getBoundingClientRect();"
            " return [b.x, b.y, b.width, b.height]; })()"
        )
        scale = min((box[2] - 56) / 64, (box[3] - 56) / 48)

        def on_page(x: float, y: float) -> tuple[float, float]:
            return (
                box[0] + box[2] / 2 + (x + 0.5 - 32) * scale,
                box[1] + box[3] / 2 + (y + 0.5 - 24) * scale,
            )

        browser.drag(on_page(55.5, 41.0), on_page(50.0, 38.0))
        browser.key("ArrowLeft")
        browser.key("z", ctrl=True)
        browser.click("#tools input[type=checkbox]")
        browser.click("#undo")
        browser.click("#redo")
        browser.until("document.getElementById('live').textContent.startsWith('lower right: ')")
        browser.click("#save")
        browser.until("document.getElementById('said').textContent")
        assert browser.value("document.getElementById('said').textContent") == (
            "points.json written, 4 marks"
        )
        assert browser.value("document.getElementById('save').disabled")
    moved = {name: tuple(place) for name, place in CORNERS.items()}
    moved["upper left"] = (9.0, 5.9)
    found = read_points(path).points
    assert found.keys() == {"default", "a.png"}
    for own in found.values():
        assert own["upper left"] == moved["upper left"]
        # A pointer stands on whole pixels of the screen, about 15 for one of the photograph.
        assert np.abs(np.subtract(own["lower right"], (50.0, 38.0))).max() <= 1.5 / scale
        assert {own[name] == moved[name] for name in ("upper right", "lower left")} == {True}


def test_balls_and_heights_are_edited_in_the_browser(
    browser: chromium.Chromium, tmp_path: Path, mesh: Path
) -> None:
    photographs = tmp_path / "lamps"
    photographs.mkdir()
    cv2.imwrite(str(photographs / "0.png"), discs(300, 160, BALLS, 0))
    (photographs / "circle_data.txt").write_text("71 100 40\n221 70 42\n")
    with served(BallOutlines(photographs)) as server:
        browser.open(server.url)
        # The middle of the second ball is the eighth handle.
        browser.key("p")
        browser.key("ArrowDown", shift=True)
        browser.key("s", ctrl=True)
        browser.until("document.getElementById('said').textContent === 'circle_data.txt written'")
    # One row further down: y is up.
    assert (photographs / "circle_data.txt").read_text() == (
        "71.000 100.000 40.000\n221.000 69.000 42.000\n"
    )
    before = read_depth(mesh).depth_mm
    with served(Mesh(mesh)) as server:
        browser.open(server.url)
        # From the middle, row 1 and column 2, to the upper right.
        browser.key("ArrowRight")
        browser.key("ArrowUp")
        browser.key("PageUp", shift=True)
        browser.key("PageDown")
        browser.key("s", ctrl=True)
        browser.until("document.getElementById('said').textContent.startsWith('depth.csv written')")
    expected = before.copy()
    expected[0, 3] += 0.09
    assert np.abs(read_depth(mesh).depth_mm - expected).max() < 1e-9


def test_a_stroke_of_the_brush_is_one_change(browser: chromium.Chromium, mesh: Path) -> None:
    before = read_depth(mesh).depth_mm
    with served(Mesh(mesh)) as server:
        browser.open(server.url)
        x, y, width, height = browser.value(
            "(() => { const b = document.getElementById('view').getBoundingClientRect();"
            " return [b.x, b.y, b.width, b.height]; })()"
        )
        browser.key("b")
        middle, beside = (x + width / 2, y + height / 2), (x + width / 2 + 40, y + height / 2 + 20)
        browser.drag(middle, beside)
        browser.key("s", ctrl=True)
        browser.until("document.getElementById('said').textContent.startsWith('depth.csv written')")
        assert np.ptp(read_depth(mesh).depth_mm) < np.ptp(before)
        browser.key("z", ctrl=True)
        assert browser.value("document.getElementById('undo').disabled")
        browser.key("s", ctrl=True)
        browser.until("document.getElementById('save').disabled")
    assert np.abs(read_depth(mesh).depth_mm - before).max() < 1e-9
