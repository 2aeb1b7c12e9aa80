"""Makes the pictures of README and documentation: `make pictures`.

Everything is computed anew, from simulated paintings and, where its photographs are at hand, from a
real icon; nothing is drawn by hand.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np

import impasto
from gallery import how_to, icon, painting
from impasto import simulate
from impasto.cli import main
from impasto.io import write_jpeg
from impasto.matching import Experiment, analyse, stimuli
from impasto.pictures import Panel, Picture, contact_sheet, fitted
from impasto.viewer import write_site

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
import chromium
import cleaned_painting
import recipe_files
import recipes

HERE = Path(__file__).parent / "_static"
HELD_OUT = 12
"""The photograph that was held out, whose lamp the page has."""
LARGEST = 300_000
"""Bytes: a picture of a page should not be larger."""
SMALL = 40_000
"""Bytes of a picture of how-to.md, which has many."""


def save(name: str, sheet: Picture, largest: int = LARGEST) -> None:
    """As JPEG, in the best quality that is small enough."""
    path = HERE / f"{name}.jpg"
    path.parent.mkdir(exist_ok=True)
    for quality in (92, 88, 84, 80, 75, 70):
        write_jpeg(path, sheet, quality=quality)
        if path.stat().st_size < largest:
            return
    raise SystemExit(f"{path} is larger than {largest} bytes")


def relit(demo: Path) -> Picture:
    """Four pictures in a row: what is measured, and what was never photographed."""
    shown = (
        ("normal", "Surface normals", "measured"),
        ("above", "Light from above", "D65"),
        ("raking", "Raking light", "shadows cast"),
        ("lamp", "Incandescent lamp", "eye adapted to 0.56"),
    )
    panels = [Panel(title, how_to.read(demo / f"{name}.png"), note) for name, title, note in shown]
    return contact_sheet(panels, columns=4, width=360)


def lobes() -> None:
    """The lobes of a pixel under gloss varnish, with its photographs."""
    painting = simulate.painting(seed=7, size=(32, 32), varnish="patches")
    capture = simulate.capture(painting, "snel-lafortune")
    sbrdf = impasto.fit_sbrdf(capture.stack, model="lafortune", lobes=3)
    sbrdf.lobe_plot(20, 12, capture.stack).savefig(HERE / "lobes.png", dpi=110)


def pictures(demo: Path) -> None:
    """Pictures of what `impasto demo` left in a folder."""
    save("relit", relit(demo))
    sheet = how_to.read(demo / "overview.jpg")
    width = 1400
    save("overview", fitted(sheet, width, round(width * sheet.shape[0] / sheet.shape[1])))


def gallery_of_the_painting() -> None:
    """A painting that was simulated, photographed and measured, in many lights."""
    measured = painting.measured()
    for name, view, columns, width in (
        ("gallery", painting.in_the_gallery, 2, 690),
        ("raking", painting.in_raking_light, 2, 690),
        ("details", painting.details, 2, 480),
        ("candle", painting.by_candlelight, 3, 456),
        ("figures-8-and-9", painting.figures_8_and_9, 2, 560),
    ):
        save(f"painting-{name}", contact_sheet(view(measured), columns=columns, width=width))
    bare, aged, clear = (
        painting.measured_coarsely(**kind)
        for kind in ({"varnish": None}, {"yellowing": painting.AGED}, {})
    )
    save("painting-varnish", contact_sheet(painting.varnished(bare), columns=3, width=456))
    sheet = contact_sheet(painting.without_varnish(aged, clear), columns=3, width=456)
    save("painting-varnish-removed", sheet)


def gallery_of_the_icon() -> None:
    """A real icon, measured from its photographs where they are at hand."""
    photographs = icon.folder()
    if not photographs.is_dir():
        sys.stderr.write(
            f"docs/pictures.py: the photographs of the icon are not at {photographs}, so its "
            "pictures stay as they are (IMPASTO_DATA names the folder that holds icon_rti)\n"
        )
        return
    measured = icon.measured(icon.upright(photographs))
    for name, view, columns, width in (
        ("gallery", icon.in_the_gallery, 3, 456),
        ("candle", icon.by_candlelight, 3, 456),
        ("varnish", icon.with_varnish, 3, 456),
        ("photographs", icon.beside_photographs, 4, 340),
    ):
        save(f"icon-{name}", contact_sheet(view(measured), columns=columns, width=width))


def compared() -> None:
    """A painting before and after its varnish was taken off in a patch."""
    size = (200, 260)
    y, x = np.mgrid[: size[0], : size[1]]
    window = ((x - 150) / 70.0) ** 4 + ((y - 95) / 55.0) ** 4 < 1.0
    one = cleaned_painting.cleaned_painting(size, window)
    fits = [cleaned_painting.fitted(*pair) for pair in ((one.before, 1), (one.after, 2))]
    found = impasto.compare(*fits, align="same")
    save("compare", found.picture())


def matched() -> None:
    """A matching experiment with simulated observers, whose mean degree is 0.56."""
    capture = simulate.default_capture("tominaga-six-band-adaptation", size=(64, 80))
    fit = impasto.fit_sbrdf(capture.stack, pooling="painting")
    spectra = impasto.fit_reflectance(capture.stack, fit, capture.truth.camera)
    shown = stimuli(fit, spectra)
    random = np.random.default_rng(1)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(14):
            own = random.normal(0.56, 0.08)
            session = Experiment(
                shown, Path(folder) / f"{number}.jsonl", observer=f"simulated {number + 1}",
                painting="landscape",
            )  # fmt: skip
            while session.trial < session.log.trials:
                wanted = own + random.normal(0.0, 0.06)
                order = session.order(session.trial)
                off = [abs(shown.degrees[which] - wanted) for which in order]
                session.save(
                    {"trial": session.trial, "position": int(np.argmin(off)), "steps": 11,
                     "seconds": 20.0}
                )  # fmt: skip
            session.close()
        save("matching", analyse(sorted(Path(folder).glob("*.jsonl"))).picture())


def beside_relight() -> None:
    """The page with the icon and what another program made of the same photographs."""
    peer = icon.folder().with_name("peer_relight") / "rbf27"
    if not peer.is_dir() or chromium.PROGRAM is None:
        sys.stderr.write(
            "docs/pictures.py: without chromium, or what relight made of the icon "
            f"({peer}), the picture of both stays as it is\n"
        )
        return
    stack = impasto.read_stack(icon.folder() / "dirs.lp", encoding="srgb")
    fold = stack.take([k for k in range(len(stack.rig)) if k % icon.HELD_OUT])
    fitted_icon = impasto.fit_sbrdf(fold, pooling="pixel")
    x, y, z = stack.rig.lights[HELD_OUT].direction
    light = f"light={np.degrees(np.arctan2(y, x)):.2f},{np.degrees(np.arcsin(z)):.2f}"
    panels = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_site(
            fitted_icon, folder / "page", title="impasto",
            against=impasto.io.read_relightable(peer), against_title="relight, 27 planes",
        )  # fmt: skip
        page = (folder / "page" / "index.html").as_uri()
        with chromium.Chromium(folder / "profile", size=(1180, 660)) as browser:
            for number, compare in enumerate(("photograph,0.5", "difference,0")):
                browser.open(f"{page}#{light}&turns=1&against={compare}")
                browser.value("new Promise(done => setTimeout(done, 2000))")
                browser.screenshot(folder / f"{number}.png")
                panels.append(how_to.narrowed(how_to.read(folder / f"{number}.png"), 900))
    save("viewer-relight", np.concatenate(panels))


def recipes_of_the_page() -> None:
    """What the recipes of how-to.md make, of a painting that is larger than in their test."""
    with tempfile.TemporaryDirectory() as name:
        folder, before = Path(name), Path.cwd()
        recipe_files.write_files(folder)
        os.chdir(folder)
        try:
            found = recipes.run(size=320).namespace
        finally:
            os.chdir(before)
        sheets = how_to.pictures(folder, found)
        if chromium.PROGRAM is None:
            sys.stderr.write(
                "docs/pictures.py: without chromium its two pictures stay as they are\n"
            )
        else:
            sheets |= seen_in_a_browser(folder, found["sbrdf"])
    for name, sheet in sheets.items():
        save(f"how-to/{name}", sheet, SMALL)


def seen_in_a_browser(folder: Path, sbrdf: impasto.Sbrdf) -> dict[str, Picture]:
    """The exported web page, and what a notebook shows."""
    cell = folder / "cell.html"
    cell.write_text(
        "<!doctype html><html data-ready='yes'><meta charset='utf-8'>"
        f"<body style='font: 14px sans-serif; margin: 16px'>{sbrdf._repr_html_()}",
        encoding="utf-8",
    )
    found = {}
    shots = {"page": (folder / "page" / "index.html", (1100, 680)), "notebook": (cell, (600, 460))}
    for name, (page, size) in shots.items():
        with chromium.Chromium(folder / f"profile-{name}", size=size) as browser:
            browser.open(page.as_uri())
            browser.value("new Promise(done => setTimeout(done, 2000))")  # all tiles are there
            browser.screenshot(folder / f"{name}.png")
        found[name] = how_to.narrowed(how_to.read(folder / f"{name}.png"), 600)
    return found


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "demo"
        if main(["demo", "--out", str(out)]) != 0:
            raise SystemExit("impasto demo failed")
        pictures(out)
    lobes()
    recipes_of_the_page()
    compared()
    matched()
    gallery_of_the_painting()
    gallery_of_the_icon()
    beside_relight()
