"""A simulated landscape in oil, measured from simulated photographs and put into other light.

No picture shows the truth of the simulation: normals, spectra and gloss are fitted to 16
photographs in six bands with the noise of a sensor, and heights are integrated from the normals.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import impasto
from gallery.measured import CANDLE, EYES, Measured, difference
from impasto import DistantLight, Environment, PointLight, PointView, Scene, Varnish, simulate
from impasto.pictures import Panel
from impasto.simulate.cameras import CAMERA_OPTIONS
from impasto.simulate.pigments import WAVELENGTHS
from impasto.simulate.surface import yellow

SEED = 0
SIZE, PITCH_MM = (1536, 2048), 0.1
"""Rows and columns, and the width of a pixel: a painting of 205 x 154 mm."""
THREAD_MM = 1.5
"""Distance of the threads: coarse linen."""
COARSE = 2
"""By this factor fewer rows and columns have the three paintings that show varnish."""
RIG = "tominaga-six-band-adaptation"
AGED = 3.0
"""Yellowing of the old varnish: three times that of a century."""
FILM_UM = 50.0
"""Thickness that is said of the old varnish; only its product with the absorption counts."""

ABOVE = DistantLight((0.0, 0.71, 0.71))
"""The light of the papers' pictures."""
RAKING = DistantLight((-0.95, 0.22, 0.21), radius=0.02)
"""A lamp of 4 cm at a distance of 1 m, from the left."""
NEARLY_IN_FRONT = DistantLight((-0.40, 0.35, 0.85))
"""Light whose mirror image reaches the eye from the flanks of the relief."""
RIGHT = (0.64, 0.0, 0.77)
"""40 degrees to the side, opposite the gallery's window."""
BESIDE = PointView((400.0, 25.0, 480.0))
"""An eye in the same direction, 60 cm away."""
FLAME = PointLight((-90.0, -120.0, 200.0), radius=6.0)
"""A candle before the lower left of the painting."""

BLOBS, CANVAS = (0.08, 0.56), (0.41, 0.33)
"""Upper left corners of the details, as shares of height and width: thick lights of the sky, and a
meadow where the paint is thin."""
PART = (0.234375, 0.234375)
"""Height and width of a detail as shares of the painting's."""


def measured(
    size: tuple[int, int] = SIZE,
    pitch_mm: float = PITCH_MM,
    *,
    varnish: simulate.paintings.VarnishKind | None = "satin",
    yellowing: float = 0.0,
) -> Measured:
    """Simulate a painting, photograph it and measure it."""
    truth = simulate.painting(
        SEED,
        size,
        varnish=varnish,
        yellowing=yellowing,
        pitch_mm=pitch_mm,
        thread_mm=THREAD_MM,
    )
    capture = simulate.capture(truth, RIG, RIG, **CAMERA_OPTIONS.get(RIG, {}))
    pooling: Any = "none" if varnish is None else "painting"
    sbrdf = impasto.fit_sbrdf(capture.stack, pooling=pooling)
    return Measured(sbrdf, impasto.fit_reflectance(capture.stack, sbrdf, capture.truth.camera))


def measured_coarsely(**kind: Any) -> Measured:
    """A painting in pixels that are larger; the options are those of :func:`measured`."""
    rows, columns = SIZE
    return measured((rows // COARSE, columns // COARSE), PITCH_MM * COARSE, **kind)


def in_the_gallery(painting: Measured) -> list[Panel]:
    """Light from all directions, from the front and slanted."""
    front = Scene(environment=Environment.named("gallery"), shadows=True)
    beside = front.changed(view=BESIDE, perspective=True)
    return [
        painting.panel("In the gallery", "from the front", front),
        painting.panel("The same", "40 degrees from the right", beside),
    ]


def in_raking_light(painting: Measured) -> list[Panel]:
    """What raking light shows that light from above does not."""
    raking = Scene([RAKING], shadows=True, exposure=2.4)
    return [
        painting.panel("Light from above", "45 degrees", Scene([ABOVE])),
        painting.panel("Raking light", "from the left, 12 degrees, shadows cast", raking),
    ]


def details(painting: Measured) -> list[Panel]:
    """Figure 1 of Snel's paper: paint blobs and canvas, without and with specular reflection."""
    scene = Scene([NEARLY_IN_FRONT], shadows=True, exposure=0.75)
    matte = replace(painting.sbrdf.surface(), lobes=())
    shown = {"diffuse part only": matte, "with specular reflection": painting.sbrdf}
    images = {note: painting.image(scene, surface).display for note, surface in shown.items()}
    rows, columns = images["diffuse part only"].shape[:2]
    high, wide = round(PART[0] * rows), round(PART[1] * columns)
    panels = []
    for title, corner in (("Paint", BLOBS), ("Canvas", CANVAS)):
        top, left = round(corner[0] * rows), round(corner[1] * columns)
        panels += [
            Panel(title, picture[top : top + high, left : left + wide], note)
            for note, picture in images.items()
        ]
    return panels


def by_candlelight(painting: Measured) -> list[Panel]:
    """A near flame, for eyes that have adapted to it by three degrees."""
    scene = Scene([FLAME], illuminant=CANDLE, shadows=True)
    return [
        painting.panel("By candlelight", note, scene.changed(adaptation=degree))
        for degree, note in EYES.items()
    ]


def figures_8_and_9(painting: Measured) -> list[Panel]:
    """Figures 8 and 9 of the six-band paper: illuminant A, front and slanted, d = 0 and 0.56."""
    front = Scene([ABOVE], illuminant="A", shadows=True)
    slanted = front.changed(lights=[DistantLight((-0.30, 0.60, 0.74))], view=RIGHT)
    return [
        painting.panel(f"Figure {figure}, {place}", note, scene.changed(adaptation=degree))
        for figure, degree, note in ((8, None, "no adaptation"), (9, 0.56, "d = 0.56"))
        for place, scene in (("front", front), ("slanted", slanted))
    ]


def varnished(bare: Measured) -> list[Panel]:
    """A painting without varnish, then under two that it never had; from the front and slanted."""
    scene = Scene(environment=Environment.named("gallery"), shadows=True)
    coats = {
        "As it is": ("no varnish", None),
        "Varnished": ("clear, glossy", Varnish(gamma=0.05)),
        "Old varnish": ("yellowed", Varnish(gamma=0.08, yellowness=8.0)),
    }
    return [
        bare.panel(title, f"{note}{place}", scene.changed(varnish=coat, view=view))
        for view, place in ((None, ""), (RIGHT, ", from the right"))
        for title, (note, coat) in coats.items()
    ]


def without_varnish(aged: Measured, clear: Measured) -> list[Panel]:
    """A painting under yellowed varnish, the varnish removed virtually, and never yellowed."""
    scene = Scene([ABOVE])
    removed = old_varnish().without()
    images = {
        "As photographed": aged.image(scene),
        "Varnish removed": aged.image(scene.changed(varnish=removed)),
        "Never yellowed": clear.image(scene),
    }
    *others, truth = images.values()
    notes = [f"dE00 {difference(image.xyz, truth.xyz):.1f}" for image in others]
    return [
        Panel(title, image.display, note)
        for (title, image), note in zip(images.items(), [*notes, "another fit"], strict=True)
    ]


def old_varnish() -> Varnish:
    """The old varnish, its absorption known as from a sample: that of the simulation, in 1/mm.

    Light crosses the simulated film straight, twice; a real one slanted. The film is as thick
    everywhere, which the simulated one is not.
    """
    straight = 2.0 * yellow(AGED)
    crossed = 1e-3 * FILM_UM * Varnish().path(0.5**0.5, 1.0)
    return Varnish(thickness_um=FILM_UM, absorption=(WAVELENGTHS, straight / crossed))
