"""The lens and the alignment: simulated photographs of known truth, and the icon.

    python benches/python/alignment.py [--data DIR] [--record]

A camera with a lens looks at a flat scene (``tests/oracles/flat_scene.py``, noise 0.005): targets
for the lens, and a chessboard between four markers for the rectification. Shifts under different
lamps: textured relief (``tests/oracles/relief.py``), a painting of ``impasto.simulate`` with
shadows, and the icon, each shifted by known parts of a pixel (the shift theorem). ``--record``
writes benches/results/alignment.json.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from record import ROOT, data_folder, run_info, show, write

from impasto import simulate
from impasto.align import (
    Grid,
    find_marks,
    frontal_view,
    layout_from_markers,
    rectified,
    relit_shifts,
    shift_between,
)
from impasto.align.refinement import gradient_picture, phase_shift
from impasto.align.relighting import EPSILON, SMOOTH, STEPS, without_gauge
from impasto.calibrate import LensCalibration, lens_from_target, luma
from impasto.calibrate.tones import light_from
from impasto.encoding import Encoding
from impasto.io import read_image, read_lights

sys.path.insert(0, str(ROOT / "tests"))

from oracles import flat_scene, relief

K = (-0.12, 0.05, 0.0008, -0.0005, 0.0)
SIZE, FOCAL, NOISE = (800, 640), 900.0, 0.005
PAINTING, SIDE = (240.0, 180.0), 40.0
TILTS = (0, 30, 45, 60, 65)
MARGIN = 8

Floats = np.ndarray


def codes(picture: Floats, seed: int) -> Floats:
    noisy = picture + np.random.default_rng(seed).normal(0, NOISE, picture.shape)
    return np.rint(65535 * np.clip(noisy, 0, 1)).astype(np.uint16)[None]


def lens() -> tuple[LensCalibration, list[dict[str, Any]]]:
    """From twelve photographs of a chessboard, tilted up to 42 degrees."""
    place = np.random.default_rng(1)
    board = flat_scene.chessboard(11, 8, 22.0, 0.25)
    pictures = []
    for number in range(12):
        camera = flat_scene.Camera(
            SIZE, FOCAL, K, tilt=(0, 25, 35, 40, 30, 38)[number % 6] + number // 6,
            azimuth=108 * number, roll=15 * number, distance=470, aim=place.uniform(-50, 50, 2),
        )  # fmt: skip
        pictures.append(codes(camera.photograph(board, 3), number))
    found = lens_from_target(pictures, "chessboard:11x8:22mm", model="brown")
    own, middle = found.lens, ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
    numbers = [own.matrix[0, 0], own.matrix[1, 1], own.matrix[0, 2], own.matrix[1, 2]]
    rows = [
        {"number": name, "truth": truth, "found": float(value), "error": float(value - truth),
         "sigma": float(sigma)}
        for name, truth, value, sigma in zip(
            ("fx, pixels", "fy, pixels", "cx, pixels", "cy, pixels", "k1", "k2", "p1", "p2", "k3"),
            (FOCAL, FOCAL, *middle, *K),
            (*numbers, *own.coefficients), (*own.matrix_sigma, *own.coefficient_sigma),
            strict=True,
        )
    ]  # fmt: skip
    corners = np.concatenate([view.found for view in found.views])
    truth = flat_scene.Camera(SIZE, FOCAL, K)
    x, y = flat_scene.undistorted(
        (corners[:, 0] - truth.centre[0]) / FOCAL, (corners[:, 1] - truth.centre[1]) / FOCAL, K
    )
    # A shift of the principal point is one of all pictures: compared without the mean.
    off = own.ideal(corners) - FOCAL * np.stack([x, y], axis=1)
    print(
        f"lens: residual {own.residual_px:.3f} pixels, tried {found.tried}, not in {found.unused}"
    )
    print(f"lens: ideal pixels off by {np.std(off, axis=0)} (standard deviation)")
    return found, rows


def scene() -> Callable[[Floats, Floats], Floats]:
    codes_of = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    bits = [cv2.aruco.generateImageMarker(codes_of, number, 6) // 255 for number in range(4)]
    return flat_scene.together(
        flat_scene.chessboard(9, 6, 20.0, 0.25), flat_scene.framed(*PAINTING, SIDE, bits)
    )


def tilts(found: LensCalibration) -> list[dict[str, Any]]:
    """Errors of a grid of 54 points, in pixels of the frontal picture."""
    points = flat_scene.grid_of(9, 6, 20.0)
    rows = []
    for tilt in TILTS:
        camera = flat_scene.Camera(
            SIZE, FOCAL, K, tilt=tilt, azimuth=20, roll=4, distance=600, aim=(2.0, -1.0)
        )
        photograph = codes(camera.photograph(scene(), 3), tilt)
        light = light_from(photograph)
        for name in (f"aruco:4x4_50:{SIDE:g}mm", "aruco:4x4_50"):
            layout = layout_from_markers(name, PAINTING)
            marks = find_marks(light, layout, "simulated")
            view = frontal_view(
                layout.mm(marks.names), marks.pixels, marks.names, PAINTING, found.lens, "simulated"
            )
            grid = Grid(PAINTING, view.pixel_mm())
            off = np.linalg.norm(view.mm(camera.pixel(points)) - points, axis=1) / grid.pixel_mm
            row = {
                "tilt": f"{tilt}°", "marks": len(marks.names), "residual": view.rms,
                "mean": float(off.mean()), "worst": float(off.max()),
            }  # fmt: skip
            picture = rectified(photograph, view, grid).planes[0]
            row["seen"] = float(_seen_corners(picture, points, grid).mean())
            rows.append(row)
    return rows


def _seen_corners(picture: Floats, points: Floats, grid: Grid) -> Floats:
    """By how much OpenCV finds the corners of the chessboard elsewhere in the frontal picture."""
    expected = np.stack([
        points[:, 0] / grid.pixel_mm + (grid.columns - 1) / 2,
        (grid.rows - 1) / 2 - points[:, 1] / grid.pixel_mm,
    ], axis=1)  # fmt: skip
    start = np.ascontiguousarray(expected[:, None].astype(np.float32))
    found = cv2.cornerSubPix(
        picture.astype(np.float32) / 65535, start, (7, 7), (-1, -1), (3, 200, 1e-5)
    )
    return np.linalg.norm(found.reshape(-1, 2) - expected, axis=1)


def interpolation(found: LensCalibration) -> list[dict[str, Any]]:
    """A fine texture through camera and rectification; truth at the middles of pixels."""
    noise = relief.smooth_noise(512, 3.0, 3)
    # Waves of 4 pixels of the photograph and longer.
    step = PAINTING[0] / 400

    def texture(x: Floats, y: Floats) -> Floats:
        at = (x / step + 256).astype(np.float32), (y / step + 256).astype(np.float32)
        return 0.5 + 0.1 * cv2.remap(
            noise.astype(np.float32), *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP
        )

    camera = flat_scene.Camera(SIZE, FOCAL, K, tilt=30, azimuth=20, distance=600)
    marks = flat_scene.Camera(SIZE, FOCAL, K, tilt=30, azimuth=20, distance=600).pixel(
        flat_scene.grid_of(3, 3, 80.0)
    )
    names = tuple(f"point {number}" for number in range(len(marks)))
    view = frontal_view(
        flat_scene.grid_of(3, 3, 80.0), marks, names, PAINTING, found.lens, "texture"
    )
    grid = Grid(PAINTING, view.pixel_mm())
    photograph = camera.photograph(texture, 3).astype(np.float32)[None]
    places = grid.mm(*np.meshgrid(np.arange(grid.columns), np.arange(grid.rows)))
    # A pixel's area blurs; the same blur belongs to the truth: that of its square in the frontal
    # picture, which at this tilt is a little smaller than that of the photograph.
    truth = np.mean([
        texture(places[..., 0] + dx * grid.pixel_mm, places[..., 1] + dy * grid.pixel_mm)
        for dx in (-1 / 3, 0, 1 / 3) for dy in (-1 / 3, 0, 1 / 3)
    ], axis=0)  # fmt: skip
    rows = []
    for name in ("lanczos", "cubic", "linear"):
        made = rectified(photograph, view, grid, interpolation=name).planes[0]
        inner = np.s_[20:-20, 20:-20]
        off = np.sqrt(np.square(made[inner] - truth[inner]).mean()) / truth[inner].std()
        rows.append({"interpolation": name, "error": 100 * float(off)})
    return rows


def lambert(slope: float, rings: tuple[tuple[int, float], ...]) -> tuple[list[Floats], Floats]:
    """Relief under rings of lamps ``(count, elevation)``."""
    pictures, directions = [], []
    for count, elevation in rings:
        for azimuth in np.arange(count) * 360.0 / count:
            pictures.append(relief.photograph(256, slope, azimuth, elevation))
            a, e = np.radians([azimuth, elevation])
            directions.append([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    return pictures, np.array(directions)


def painting() -> tuple[list[Floats], Floats]:
    made = simulate.painting(seed=1, size=(256, 256))
    rig = simulate.rig("tominaga-six-band-adaptation")
    capture = simulate.capture(made, rig, camera="rgb", shadows=True)
    return [one.astype(float).mean(axis=0) for one in capture.stack.samples], rig.directions


def icon(data: Path) -> tuple[list[Floats], Floats]:
    file = read_lights(data / "icon_rti" / "dirs.lp")
    curve = Encoding("srgb", 255.0)
    chosen = range(0, len(file), 3)
    names = [file.names[index] for index in chosen]
    pictures = [luma(curve.decode(read_image(data / "icon_rti" / name))) for name in names]
    return pictures, file.directions[list(chosen)]


def shifts(name: str, pictures: list[Floats], directions: Floats) -> dict[str, Any]:
    """Errors of shifts: of none, of two photographs alone, of all of them by up to 1 pixel.

    Of all, the part that the directions of lamps explain is left out: no method sees it.
    """
    moves = np.random.default_rng(5).uniform(-1.0, 1.0, (len(pictures), 2))
    inner = slice(MARGIN, -MARGIN)

    def light(picture: Floats, move: Floats) -> Floats:
        moved = np.maximum(relief.shifted(picture, *move), 0.0)
        return np.ascontiguousarray((moved / np.median(picture))[inner, inner], dtype=np.float32)

    def errors_of(some: Floats, truth: Floats) -> Floats:
        lit = [light(*pair) for pair in zip(pictures, some, strict=True)]
        # Refused ones are 0, which counts as an error.
        found = np.array([(one.x, one.y) for one in relit_shifts(lit, directions)])
        return np.linalg.norm(found - truth, axis=1)

    still, two = np.zeros_like(moves), np.zeros_like(moves)
    two[[1, 5]] = (0.9, -0.6)
    moved = [light(*pair) for pair in zip(pictures, moves, strict=True)]
    off = errors_of(moves, without_gauge(moves, directions))
    row: dict[str, Any] = {
        "case": name, "none": float(errors_of(still, still).mean()),
        "two": float(errors_of(two, two).mean()), "mean": float(off.mean()),
        "worst": float(off.max()),
    }  # fmt: skip
    opposite = []
    for first in range(len(pictures)):
        second = int(np.argmin(directions[:, :2] @ directions[first, :2]))
        if first < second and np.linalg.norm(directions[[first, second], :2], axis=1).min() > 0.5:
            opposite.append((first, second))
    errors: dict[str, list[float]] = {"ecc": [], "phase": [], "lucas": []}
    for first, second in opposite[:6]:
        one, other = (gradient_picture(moved[index]) for index in (first, second))
        want = moves[second] - moves[first]
        made = shift_between(moved[first], moved[second])
        # What was refused counts as no shift.
        errors["lucas"].append(float(np.hypot(*(np.array([made.x, made.y]) - want))))
        errors["phase"].append(float(np.hypot(*(np.array(phase_shift(one, other)) - want))))
        errors["ecc"].append(float(np.hypot(*(ecc(one, other) - want))))
    return row | {key: float(np.mean(values)) for key, values in errors.items()}


def ecc(first: Floats, second: Floats) -> Floats:
    """OpenCV's maximisation of the enhanced correlation coefficient, from phase correlation."""
    warp = np.eye(2, 3, dtype=np.float32)
    warp[:, 2] = phase_shift(first, second)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, STEPS, EPSILON)
    try:
        _, warp = cv2.findTransformECC(
            first, second, warp, cv2.MOTION_TRANSLATION, stop, None, SMOOTH
        )
    except cv2.error:
        return np.zeros(2)
    return np.asarray(warp[:, 2], np.float64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument(
        "--record", action="store_true", help="write benches/results/alignment.json"
    )
    options = parser.parse_args()
    calibration, numbers = lens()
    show("lens from simulated targets", numbers)
    grids = tilts(calibration)
    show("grid in the frontal picture, pixels", grids)
    resampled = interpolation(calibration)
    show("error of resampling, % of the contrast", resampled)
    rings = ((8, 35.0), (4, 65.0))
    moved = [
        shifts(f"relief, slopes of {slope}° rms, 12 lamps", *lambert(slope, rings))
        for slope in (3, 8, 15)
    ]
    moved.append(shifts("simulated painting with shadows, 16 lamps", *painting()))
    moved.append(shifts("icon, 24 of its lamps", *icon(options.data)))
    show("shifts between photographs, pixels", moved)
    if options.record:
        content = {
            "run": run_info("python benches/python/alignment.py --record"),
            "residual_px": calibration.lens.residual_px, "lens": numbers, "tilts": grids,
            "interpolation": resampled, "shifts": moved,
        }  # fmt: skip
        print(f"\nwrote {write('alignment.json', content)}")


if __name__ == "__main__":
    main()
