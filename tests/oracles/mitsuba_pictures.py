"""Pictures of a small bumpy painting by Mitsuba 3, kept in ``mitsuba_pictures.npz``.

    pip install mitsuba
    DRJIT_LIBLLVM_PATH=... python tests/oracles/mitsuba_pictures.py

The painting and its lamps are made here from numbers, without Mitsuba, so that tests can show them
to impasto. ``mitsuba_models.py`` has Mitsuba's side, and says which libLLVM serves. Pictures are
linear light, white board 1.0, one ray through the centre of each pixel, in single precision.

Rooms are integrated by the midpoint rule over directions: Mitsuba's ``envmap`` says how bright each
direction is, its surface interaction and the BSDF how much of it the pixel reflects.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

FILE = Path(__file__).with_suffix(".npz")
SHAPE = (16, 22)
PITCH_MM = 2.0
STRAIGHT = (0.0, 0.0, 1.0)

LAMPS = {
    "distant": ("distant", (0.4, 0.3, 0.6), 1.0),
    "raking": ("distant", (-0.7, 0.6, 0.2), 0.8),
    "near": ("near", (20.0, -15.0, 60.0), 0.7),
}
"""Kind, direction or position in mm, irradiance in the middle."""

VIEWS = {
    "straight": (STRAIGHT, False),
    "slanted": ((0.5, -0.2, 0.8), False),
    "eye": ((15.0, -20.0, 90.0), True),
}
"""A direction, or with True a position in mm."""

MODELS = ("diffuse", "torrance-sparrow", "two coats", "lafortune")
TURNS = {"room": 0.0, "turned room": 0.6}
"""Radians by which the room is turned about the painting's vertical."""


def painting():
    """Maps of all models: waves with slopes up to one, and parameters from pixel to pixel."""
    rng = np.random.default_rng(19)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / 5.0
    normal = np.stack([0.5 * np.sin(x + y), 0.45 * np.cos(y - 0.6 * x), np.ones(SHAPE)])
    normal[:2] += rng.normal(0.0, 0.1, (2, *SHAPE))
    normal /= np.linalg.norm(normal, axis=0)
    exponent = np.exp(rng.uniform(np.log(2.0), np.log(80.0), (2, *SHAPE)))
    # Sharp lobes stay near the mirror's: elsewhere they would be a million times white.
    psi = rng.uniform(-1.0, 1.0, (2, *SHAPE)) / exponent
    maps = {
        "normal": normal,
        "diffuse": rng.uniform(0.05, 0.9, (3, *SHAPE)),
        "beta": rng.uniform(1.0, 6.0, (2, *SHAPE)),
        "gamma": rng.uniform(0.06, 0.5, (2, *SHAPE)),
        "specular": rng.uniform(0.05, 0.6, (2, 3, *SHAPE)),
        "cxy": np.sin(psi) - np.cos(psi),
        "cz": np.sin(psi) + np.cos(psi),
        "exponent": exponent,
    }
    return {name: plane.astype(np.float32) for name, plane in maps.items()}


def room(polar=None):
    """Radiance ``(3, 256, 512)`` of a smooth room: a constant 1 / pi is a white board's white.

    Longitude and latitude; the middle is in front of the painting, the upper edge up, columns as
    somebody sees them who stands at the painting. Lamps are lobes about directions in which nothing
    is symmetric; what is behind the painting is bright, too, and must not show. ``polar``: the
    angles of the rows from the upper edge; default: the middles of 256 equal ones.
    """
    columns = 512
    if polar is None:
        polar = (np.arange(256) + 0.5) * np.pi / 256
    around = (np.arange(columns) + 0.5) * 2.0 * np.pi / columns - np.pi
    polar, around = np.meshgrid(polar, around, indexing="ij")
    x = -np.sin(polar) * np.sin(around)
    y, z = np.cos(polar), np.sin(polar) * np.cos(around)
    lamps = [
        ((0.6, 0.5, 0.6), (2.0, 1.0, 0.5), 0.35),
        ((-0.8, -0.1, 0.3), (0.3, 0.8, 1.5), 0.25),
        ((0.1, 0.2, -1.0), (3.0, 3.0, 3.0), 0.5),
    ]
    total = np.full((3, *x.shape), 0.05)
    for towards, colour, width in lamps:
        towards = np.asarray(towards) / np.linalg.norm(towards)
        cosine = towards[0] * x + towards[1] * y + towards[2] * z
        total += np.multiply.outer(colour, np.exp((cosine - 1.0) / width**2))
    return total.astype(np.float32)


def bsdf(models, name, maps):
    """A model in Mitsuba about the painting's normals."""
    pairs = {"torrance-sparrow": 1, "two coats": 2}
    if name == "diffuse":
        plain = models.diffuse(maps["diffuse"])
    elif name in pairs:
        coats = (maps[which][: pairs[name]] for which in ("beta", "gamma"))
        plain = models.torrance_sparrow(maps["diffuse"], *coats)
    else:
        lobes = (maps[which] for which in ("specular", "cxy", "cz", "exponent"))
        plain = models.lafortune(maps["diffuse"], *lobes)
    return models.with_normals(plain, maps["normal"])


def lamp_pictures(models):
    """``"model / lamp / view"``: ``(3, y, x)``."""
    maps, made = painting(), {}
    x = (np.arange(SHAPE[1]) - 0.5 * (SHAPE[1] - 1)) * PITCH_MM
    y = (0.5 * (SHAPE[0] - 1) - np.arange(SHAPE[0])) * PITCH_MM
    for name in MODELS:
        for lamp, (kind, where, intensity) in LAMPS.items():
            for view, (eye, near_eye) in VIEWS.items():
                shown = models.scene(
                    bsdf(models, name, maps), SHAPE, PITCH_MM,
                    [getattr(models, kind)(where, intensity)], view=eye, near_eye=near_eye,
                )  # fmt: skip
                hit = models.seen(shown)
                # Rays go through the centres of pixels, a millionth of a pixel aside.
                assert (
                    np.abs(hit - np.stack(np.broadcast_arrays(x, y[:, None], 0.0), -1)).max() < 1e-4
                )
                made[f"{name} / {lamp} / {view}"] = models.picture(shown)
    return made


def room_pictures(models, rows=256, part=8):
    """``"model / turn"``: ``(3, y, x)``; directions on a grid of ``rows`` times ``2 rows``."""
    mi, maps, made = models.mi, painting(), {}
    # Columns of Mitsuba's map run the same way, its middle is along +z before it is turned, but its
    # first and last row are the poles themselves.
    radiance = np.moveaxis(room(np.linspace(0.0, np.pi, 257)), 0, -1)
    bitmap = mi.Bitmap(radiance)
    polar = (np.arange(rows) + 0.5) * np.pi / rows
    around = (np.arange(2 * rows) + 0.5) * np.pi / rows
    polar, around = (plane.ravel() for plane in np.meshgrid(polar, around, indexing="ij"))
    towards = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)]
    )
    edges = np.cos(polar - 0.5 * np.pi / rows) - np.cos(polar + 0.5 * np.pi / rows)
    solid = edges * np.pi / rows
    ahead = towards[2] > 0.0
    towards, solid = towards[:, ahead], solid[ahead]
    for turn, angle in TURNS.items():
        pose = mi.ScalarTransform4f().rotate([0.0, 1.0, 0.0], float(np.degrees(angle)))
        light = {"type": "envmap", "bitmap": bitmap, "to_world": pose}
        for name in MODELS:
            shown = models.scene(bsdf(models, name, maps), SHAPE, PITCH_MM, [light])
            found = models.integrated(shown, towards, solid, part)
            made[f"{name} / {turn}"] = found.astype(np.float32)
    return made


def main():
    import mitsuba_models as models

    mi = models.use("llvm_ad_rgb")
    made = lamp_pictures(models) | room_pictures(models)
    np.savez_compressed(FILE, **made, mitsuba=np.array(mi.__version__))


if __name__ == "__main__":
    main()
