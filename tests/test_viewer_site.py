"""The page of a painting as a folder and on the loopback: what it holds, and who may reach it."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.cli import main
from impasto.surface import Surface
from impasto.viewer import Contents, Site, ViewServer, script, write_site
from impasto.viewer.layout import SHOWN, UNIT, Layout
from impasto.viewer.scripts import style
from loopback import fetched, request, running, serving

LARGEST_PAGE = 150_000
"""Bytes of script and style, which must arrive before anything is shown."""


def surface(rows: int = 20, columns: int = 30, **options: Any) -> Surface:
    random = np.random.default_rng(1)
    normal = np.zeros((3, rows, columns), np.float32)
    normal[:2] = random.normal(0.0, 0.2, (2, rows, columns))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.1, 0.8, (3, rows, columns)).astype(np.float32)
    return Surface.torrance_sparrow(normal, diffuse, 2.0, 0.2, **options)


@pytest.fixture
def page() -> Iterator[ViewServer]:
    with serving(ViewServer(Contents(surface(), title='<b> "Title" </script>'))) as server:
        yield server


def data_of(text: bytes, name: str) -> bytes:
    """What a script hands to the page."""
    found = re.fullmatch(rb'window\.impasto\.arrived\("([^"]+)", "([A-Za-z0-9+/=]+)"\);\n', text)
    assert found is not None
    assert found[1].decode() == name
    return base64.b64decode(found[2])


def test_a_tile_holds_the_maps_as_the_document_says(page: ViewServer) -> None:
    """Read by the document alone, in numpy."""
    text = request(page, f"/{page.token}/document.js").data.decode("ascii")
    prefix, _, rest = text.partition("= { document: ")
    document = json.loads(rest.removesuffix(" };\n"))
    assert prefix == "window.impasto "
    assert (document["width"], document["height"]) == (30, 20)
    (scale,) = document["scales"]
    assert scale == {"factor": 1, "width": 30, "height": 20}
    answer = request(page, f"/{page.token}/tiles/0/0-0.js")
    assert answer.kind == "text/javascript; charset=utf-8"
    data = gzip.decompress(data_of(answer.data, "tiles/0/0-0"))
    types = {"int16": "<i2", "half": "<f2", "single": "<f4"}
    planes = {}
    for group in document["groups"]:
        count = group["layers"] * 20 * 30 * 4
        kind = np.dtype(types[group["number"]])
        texels = np.frombuffer(data, kind, count).reshape(group["layers"], 20, 30, 4)
        data = data[count * kind.itemsize :]
        for index, name in enumerate(group["planes"]):
            planes[name] = texels[index // 4, :, :, index % 4]
    assert data == b""
    shown = surface()
    for axis, name in enumerate("xyz"):
        # Half a step of 1 / 32767.
        assert np.abs(planes[name] / UNIT - shown.normal[axis]).max() <= 0.51 / UNIT
    # Half precision has 11 bits: half a step is 2^-12 of the number.
    assert np.allclose(planes["diffuse1"], shown.diffuse[1], rtol=2.0**-11, atol=0)
    assert np.allclose(planes["gamma0"].astype(float), 0.2, rtol=2.0**-11)
    assert (planes["flags"] >= SHOWN).all()


def test_no_tile_holds_what_is_no_number() -> None:
    given = surface()
    normal = given.normal.copy()
    normal[:, 3, 4] = np.nan
    beta = np.full((20, 30), 2.0, np.float32)
    beta[5, 6] = np.inf
    gamma = np.full((20, 30), 0.2, np.float32)
    gamma[7, 8] = np.nan
    beta[9, 9], gamma[9, 9] = 0.0, np.nan  # a lobe that is not there
    broken = Surface.torrance_sparrow(normal, given.diffuse, beta, gamma)
    status = np.zeros((20, 30), np.uint8)
    status[3, 4] = 18
    layout = Layout.of(broken)
    data = gzip.decompress(layout.tile(broken, status))
    count = 20 * 30 * 4
    flags = np.frombuffer(data, "<i2", count).reshape(20, 30, 4)[..., 3]
    assert sorted(zip(*map(np.ndarray.tolist, np.nonzero(flags < SHOWN)), strict=True)) == [
        (3, 4), (5, 6), (7, 8)
    ]  # fmt: skip
    assert flags[3, 4] == 18
    assert np.isfinite(np.frombuffer(data, "<f2", offset=2 * count)).all()


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "evil.example:{}", "[::1]:{}", None])
def test_the_host_must_be_the_server_s_own(page: ViewServer, host: str | None) -> None:
    said = None if host is None else host.format(page.server_port)
    assert request(page, f"/{page.token}/document.js", Host=said).status == 403
    assert request(page, f"/{page.token}/", Host=f"localhost:{page.server_port}").status == 200


def test_the_address_needs_the_token(page: ViewServer) -> None:
    others = ["/", "/index.html", f"/{page.token}", f"/{page.token[:-1]}/", f"/{'x' * 32}/"]
    for path in [*others, "/tiles/0/0-0.js", f"/x/{page.token}/", f"/?{page.token}/"]:
        assert request(page, path).status == 403, path
    assert page.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    "path",
    ["../server.py", "..%2fserver.py", "../../../../../etc/passwd", "%2e%2e/%2e%2e/etc/passwd",
     "tiles/0/0-1.js", "tiles/1/0-0.js", "tiles/99/0-0.js", "tiles/0/-1-0.js", "tiles/0/0-0",
     "tiles/0/0-0.js/..", "tiles/0/999999-0.js", "photographs/0.js", "viewer.js%00",
     "viewer.mjs", "page/viewer.js", "script.py", "//index.html"],
)  # fmt: skip
def test_nothing_else_can_be_fetched(page: ViewServer, path: str) -> None:
    answer = request(page, f"/{page.token}/{path}")
    assert (answer.status, answer.error) == (404, "there is nothing at this address")


def test_nothing_can_be_sent(page: ViewServer) -> None:
    assert request(page, f"/{page.token}/document.js", b"{}").status == 405


def test_the_page_may_load_nothing_from_elsewhere(page: ViewServer) -> None:
    answer = request(page, f"/{page.token}/")
    policy = answer.headers["Content-Security-Policy"].split("; ")
    assert policy[0] == "default-src 'none'"
    words = {word for part in policy for word in part.split()[1:]}
    assert words <= {"'none'", "'self'", "data:", "blob:"}
    assert "connect-src" not in answer.headers["Content-Security-Policy"]
    inside = re.search(rb'Content-Security-Policy" content="([^"]*)"', answer.data)
    assert inside is not None
    words = {word for part in inside[1].decode().split("; ") for word in part.split()[1:]}
    assert words <= {"'none'", "'self'", "file:", "data:", "blob:"}
    addresses = {"http://www.w3.org/ns/anno.jsonld", "http://www.w3.org/TR/media-frags/"}
    for name in ("", "viewer.js", "style.css", "document.js"):
        text = request(page, f"/{page.token}/{name}").data.decode()
        found = set(re.findall(r"https?://[^\s\"'`]+", text))
        assert found <= addresses | {"http://www.w3.org/2000/svg"}, name


def test_the_page_is_small() -> None:
    """What must arrive before anything is shown, besides the maps."""
    assert len(script().encode()) + len(style().encode()) < LARGEST_PAGE
    assert len(script("notebook").encode()) < LARGEST_PAGE, "with the style in it"
    assert script("module").rstrip().endswith("export { mount, pageHost, scriptSource };")
    assert "import " not in re.sub(r"//.*", "", script())


def test_a_site_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out" / "site"
    site = write_site(surface(), folder, title="First")
    assert isinstance(site, Site)
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert site.files == len(files)
    assert site.size == sum(path.stat().st_size for path in files)
    assert site.script < LARGEST_PAGE
    before = {path: path.read_bytes() for path in files}

    def broken(*_: Any) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Layout, "tile", broken)
    with pytest.raises(OSError, match="No space left"):
        write_site(surface(), folder, title="Second")
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    assert [one.name for one in folder.parent.iterdir()] == ["site"]
    monkeypatch.undo()
    write_site(surface(), folder, title="Second")
    assert b"Second" in (folder / "document.js").read_bytes()


def test_a_folder_of_something_else_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"mine")
    with pytest.raises(impasto.ArgumentError, match=r"holds photo\.jpg"):
        write_site(surface(), tmp_path)
    site = tmp_path / "site"
    write_site(surface(), site)
    (site / "notes.txt").write_text("mine")
    with pytest.raises(impasto.ArgumentError, match=r"holds notes\.txt"):
        write_site(surface(), site)
    assert (site / "notes.txt").read_text() == "mine"


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
@pytest.mark.parametrize("name", ["tiles", "document.js", "photographs", "index.html"])
def test_links_in_a_site_s_folder_lead_nowhere(tmp_path: Path, name: str) -> None:
    """Whoever may write into an older site must not have what lies elsewhere replaced or read."""
    elsewhere = tmp_path / "elsewhere"
    write_site(surface(), elsewhere)
    before = {path: path.read_bytes() for path in elsewhere.rglob("*") if path.is_file()}
    site = tmp_path / "site"
    write_site(surface(), site, title="Before")
    if (site / name).is_dir():
        shutil.rmtree(site / name)
    else:
        (site / name).unlink(missing_ok=True)
    (site / name).symlink_to(elsewhere / name)
    with pytest.raises(impasto.ArgumentError, match=f"{name} in .* is a link"):
        write_site(surface(), site)
    # A link within a folder of tiles goes with the folder; where it led nothing changes.
    (site / name).unlink()
    shutil.copytree(elsewhere, site, dirs_exist_ok=True)
    (site / "tiles" / "0" / "0-0.js").unlink()
    (site / "tiles" / "0" / "0-0.js").symlink_to(elsewhere / "tiles" / "0" / "0-0.js")
    write_site(surface(), site, title="After")
    assert not (site / "tiles" / "0" / "0-0.js").is_symlink()
    assert {p: p.read_bytes() for p in elsewhere.rglob("*") if p.is_file()} == before
    link = tmp_path / "link"
    link.symlink_to(elsewhere)
    with pytest.raises(impasto.ArgumentError, match="a file or a link"):
        write_site(surface(), link)


@pytest.mark.skipif(os.name == "nt", reason="names there hold no control characters")
def test_a_name_of_a_file_commands_neither_terminal_nor_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Escape sequences, the end of a line and of a script, and a change of direction."""
    name = "a\x1b]0;b\x07\n\u202ec</script><i>&\u2028"
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]]
    samples = surface().predict(lights) + random.normal(0.0, 1e-3, (4, 3, 20, 30))
    fitted = impasto.fit_sbrdf(impasto.Stack(samples, lights=lights), pooling="none")
    fitted.save(tmp_path / "result.npz")
    folder = tmp_path / name.replace("/", "-")
    folder.mkdir()
    (tmp_path / "result.npz").rename(folder / "sbrdf.npz")
    out = f"{folder.name} page"
    assert main(["export", "web", folder.name, "--against", folder.name, "--out", out]) == 0
    said = capsys.readouterr()
    assert not set("\x1b\x07\u202e\u2028") & set(said.out + said.err)
    document = (tmp_path / out / "document.js").read_text("utf-8")
    assert document.isascii()
    assert document.count("\n") == 1
    assert "\\u001b]0;b\\u0007" in document
    assert main(["view", f"{folder.name}x", "--no-browser"]) == 1
    said = capsys.readouterr()
    assert not set("\x1b\x07\u202e\u2028") & set(said.out + said.err)


def test_photographs_must_be_of_the_painting() -> None:
    random = np.random.default_rng(0)
    lights = [[0.0, 0.6, 0.8], [0.6, 0.0, 0.8], [0.0, 0.0, 1.0]]
    stack = impasto.Stack(random.uniform(0.1, 0.5, (3, 3, 20, 31)), lights=lights)
    with pytest.raises(impasto.ArgumentError, match="20 x 30 pixels"):
        Contents(surface(), stack=stack)
    six = impasto.Stack(random.uniform(0.1, 0.5, (3, 6, 20, 30)), lights=lights)
    with pytest.raises(impasto.ArgumentError, match="6 bands"):
        Contents(surface(), stack=six)
    fine = impasto.Stack(random.uniform(0.1, 0.5, (3, 3, 20, 30)), lights=lights)
    with pytest.raises(impasto.ArgumentError, match="photograph"):
        Contents(surface(), stack=fine, shown=[7])


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_the_command_shows_a_result_until_ctrl_c(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]]
    samples = surface().predict(lights) + random.normal(0.0, 1e-3, (4, 3, 20, 30))
    impasto.fit_sbrdf(impasto.Stack(samples, lights=lights), pooling="none").save(
        tmp_path / "painting.npz"
    )
    with running(["view", "painting.npz", "--no-browser", "--pitch", "0.25"], tmp_path) as url:
        assert fetched(url).startswith(b"<!doctype html>")
        document = fetched(f"{url}document.js").decode()
        assert '"title":"painting",' in document
        assert '"pitch":0.25' in document
        assert fetched(f"{url}tiles/0/0-0.js").startswith(b"window.impasto.arrived(")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("nowhere", "nowhere does not exist"),
        ("nowhere --port 70000", "--port: expected 0 to 65535"),
        ("nowhere --pitch -1", "--pitch"),
        ("nowhere --threads 0", "--threads"),
    ],
)
def test_mistakes_are_named(
    words: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["view", *words.split(), "--no-browser"]) == 1
    assert said in capsys.readouterr().err
