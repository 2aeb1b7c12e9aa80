"""The depth mesh of moving views: simulated photographs of a relief of known heights.

    python benches/python/depth.py [--record]

The camera and the lens of ``alignment.py``, which is calibrated as there; ``relief_scene.py`` of
tests/oracles meets the rays of each pixel with the relief, -1.49 to 2.44 mm high as in the third
paper, matte, each photograph under another lamp. Four markers around the painting are found in the
photographs: poses, lens and relief are all estimated. ``--record`` writes
benches/results/depth.json.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from alignment import FOCAL, NOISE, PAINTING, SIDE, SIZE, K, lens
from record import run_info, show, write

from impasto.align import (
    DepthMesh,
    Grid,
    camera_poses,
    find_depth,
    find_marks,
    frontal_view,
    layout_from_markers,
)
from impasto.calibrate import Lens
from impasto.calibrate.tones import light_from
from impasto.depth_mesh import seen_at
from impasto.io.session.linear_codes import Photograph
from oracles import flat_scene, relief, relief_scene

Floats = np.ndarray

VIEWS = ((0, 0), (20, 200), (30, 40), (30, 160), (30, 280), (45, 0), (45, 90), (45, 180), (45, 270),
         (60, 20), (60, 110), (60, 200), (60, 290))  # fmt: skip
"""Tilts and azimuths of the camera, degrees."""
LOW, HIGH = -1.49, 2.44
TEXTURE = 0.5
"""Mm of the painting in a pixel of the texture, whose finest waves are four of them."""
MATTE, VARNISH = (0.0, 1.0), (3.0, 150.0)
"""Strength and exponent of the lobe: highlights of a varnish are clipped over many pixels."""
BARE = 35.0
"""Radius of the part without texture, mm."""


def albedo_of(bare: bool) -> Callable[[Floats, Floats], Floats]:
    """A painted texture between markers on a bright ground, with or without an even part."""
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    bits = [cv2.aruco.generateImageMarker(codes, number, 6) // 255 for number in range(4)]
    markers = flat_scene.framed(*PAINTING, SIDE, bits, 0.25)
    noise = relief.smooth_noise(1024, 4.0, 3).astype(np.float32)
    width, height = PAINTING

    def albedo(x: Floats, y: Floats) -> Floats:
        at = (x / TEXTURE + 512).astype(np.float32), (y / TEXTURE + 512).astype(np.float32)
        waves = cv2.remap(noise, *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
        if bare:
            waves = waves * flat_scene.step(np.hypot(x - 30, y + 10) - BARE, 2.0)
        inside = flat_scene.step(width / 2 - abs(x), 0.3) * flat_scene.step(
            height / 2 - abs(y), 0.3
        )
        return 0.9 + inside * (np.exp(0.35 * waves - 1.0) - 0.9) + markers(x, y)

    return albedo


def measured(
    found: Lens, name: str, wave: float, *, bare: bool = False, gloss: tuple[float, float] = MATTE
) -> dict[str, Any]:
    """Errors of one relief: of heights, and of places in the aligned pictures."""
    surface = relief_scene.bumps(*PAINTING, LOW, HIGH, wave, 20.0, seed=2)
    albedo, layout = albedo_of(bare), layout_from_markers(f"aruco:4x4_50:{SIDE:g}mm", PAINTING)
    cameras, pictures, views = [], [], []
    for number, (tilt, azimuth) in enumerate(VIEWS):
        camera = flat_scene.Camera(
            SIZE, FOCAL, K, tilt=tilt, azimuth=azimuth, roll=4, distance=600, aim=(2.0, -1.0)
        )
        turn = np.radians(1.3 * azimuth + 50 * number)
        lamp = np.array([0.64 * np.cos(turn), 0.64 * np.sin(turn), 0.77])
        light = relief_scene.photograph(camera, surface, albedo, lamp, 2, gloss)
        noisy = 0.8 * light + np.random.default_rng(number).normal(0.0, NOISE, light.shape)
        picture = np.rint(65535 * np.clip(noisy, 0, 1)).astype(np.uint16)[None]
        marks = find_marks(light_from(picture), layout, f"photograph {number}")
        views.append(
            frontal_view(
                layout.mm(marks.names), marks.pixels, marks.names, PAINTING, found,
                f"photograph {number}",
            )
        )  # fmt: skip
        cameras.append(camera)
        pictures.append(picture)
    own = camera_poses(views)
    assert own is not None
    grid = Grid(PAINTING, float(f"{min(view.pixel_mm() for view in views):.3g}"))
    depth = find_depth(lambda number: Photograph(pictures[number], 65535.0), views, own, grid)
    reach = np.array(PAINTING) / 2 - 2.0
    points = np.stack(
        np.meshgrid(np.linspace(-reach[0], reach[0], 120), np.linspace(-reach[1], reach[1], 90)), -1
    ).reshape(-1, 2)
    truth = surface(*points.T)[0]

    def off(mesh: DepthMesh | None, number: int) -> Floats:
        heights = np.zeros(len(points)) if mesh is None else mesh.at(points)
        shown = relief_scene.pixel_of(cameras[number], np.column_stack([points, truth]))
        placed = seen_at(points, heights, own[number].place_mm)
        return np.linalg.norm(views[number].mm(shown) - placed, axis=1) / grid.pixel_mm

    rows = []
    for tilt in sorted({tilt for tilt, _ in VIEWS}):
        some = [number for number, view in enumerate(VIEWS) if view[0] == tilt]
        flat = np.concatenate([off(None, number) for number in some])
        left = np.concatenate([off(depth.mesh, number) for number in some])
        rows.append({
            "tilt": f"{tilt}°", "flat": _rms(flat), "flat_worst": float(flat.max()),
            "rms": _rms(left), "most": float(np.percentile(left, 95)), "worst": float(left.max()),
        })  # fmt: skip
    error = depth.mesh.at(points) - truth
    sigma = DepthMesh(PAINTING, depth.mesh.sigma_mm, depth.mesh.sigma_mm).at(points)
    before, after = depth.left_px
    places = np.linalg.norm([
        np.array(camera.place) - pose.place_mm for camera, pose in zip(cameras, own, strict=True)
    ], axis=1)  # fmt: skip
    row = {
        "case": name, "nodes": "{1} x {0}".format(*depth.mesh.depth_mm.shape),
        "height_mm": _rms(error), "worst_mm": float(np.abs(error).max()),
        "ratio": _rms(error / sigma), "before_px": before, "after_px": after,
        "steep_px": rows[-1]["rms"], "steep_most_px": rows[-1]["most"],
        "camera_mm": float(places.max()),
    }  # fmt: skip
    show(name, [row])
    return {"pixel_mm": grid.pixel_mm, "tilts": rows, "row": row}


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.square(values).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--record", action="store_true", help="write benches/results/depth.json")
    options = parser.parse_args()
    found = lens()[0].lens
    cases = [
        measured(found, "waves of 60 mm and longer", 60.0),
        measured(found, "waves of 40 mm and longer", 40.0),
        measured(found, "waves of 25 mm and longer", 25.0),
        measured(found, "waves of 40 mm, a disc of 70 mm without texture", 40.0, bare=True),
        measured(found, "waves of 40 mm, varnished", 40.0, gloss=VARNISH),
    ]
    rows = [case["row"] for case in cases]
    show("errors of places, pixels, waves of 40 mm", cases[1]["tilts"])
    show("heights", rows)
    if options.record:
        content = {
            "run": run_info("python benches/python/depth.py --record"),
            "pixel_mm": cases[1]["pixel_mm"], "tilts": cases[1]["tilts"], "cases": rows,
        }  # fmt: skip
        print(f"\nwrote {write('depth.json', content)}")


if __name__ == "__main__":
    main()
