"""What planning a picture saves, and what it costs.

    python benches/python/plans.py [--size 1024] [--record]

The same surface and scene, forced (every effect that is there, everywhere) and planned. Times are
CPU times of one thread, the shortest of 60 (of a plan, which takes no millisecond, of 400).
``largest`` is the largest CIEDE2000 difference of a pixel of the whole picture, ``bound`` what the
plan promised.

``planning`` is the time of a plan when the statistics of the surface are there, for pictures of
more and more tiles of 256 x 256 pixels; a picture of a billion pixels has 15 259.

    python benches/python/plans.py --saved [--size 1024] [--record]

What reading the file of a fit takes, and what the statistics of its maps.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from record import run_info, show, write

import impasto
from impasto import simulate

REPEATS = 60


def light(azimuth: float, elevation: float) -> impasto.DistantLight:
    turn, up = math.radians(azimuth), math.radians(elevation)
    across = math.cos(up)
    return impasto.DistantLight((across * math.cos(turn), across * math.sin(turn), math.sin(up)))


def shortest(work: Callable[[], Any], repeats: int = REPEATS) -> float:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def surfaces(size: int) -> dict[str, impasto.Surface]:
    """A simulated painting in three bands, its varnish as maps of three lobes."""
    painting = simulate.painting(size=(size, size), varnish="patches")
    matrix = np.random.default_rng(0).random((3, len(painting.coefficients)))
    bands = np.tensordot(matrix / matrix.sum(), painting.coefficients, axes=1).astype(np.float32)
    bands = np.clip(bands, 0.02, 0.9)
    place = {"height": painting.height, "pitch_mm": painting.pitch_mm}
    zero = np.zeros((3, size, size), np.float32)
    beta, gamma = zero.copy(), zero + np.float32(0.1)
    beta[:, : size // 4] = 0.5
    make = impasto.Surface.torrance_sparrow
    return {
        "matte": make(painting.normal, bands, zero, gamma, **place),
        "varnish on a quarter": make(painting.normal, bands, beta, gamma, **place),
        "level, varnished": make(_level(painting.normal), bands, 0.5, 0.08, **place),
    }


def _level(normal: Any) -> Any:
    """Normals of a twentieth of the slope: a panel without relief."""
    slopes = normal[:2] / normal[2] / 20.0
    level = np.stack([*slopes, np.ones_like(slopes[0])])
    return (level / np.linalg.norm(level, axis=0)).astype(np.float32)


def scenes() -> list[tuple[str, str, impasto.Scene, str | float]]:
    lamp = impasto.PointLight((0.0, 9e5, 9e5))
    return [
        ("frontal, matte", "matte", impasto.Scene([light(90, 75)], shadows=True), 0),
        ("frontal, far lamp", "matte", impasto.Scene([lamp], exposure=1.0), "dE:0.5"),
        ("lobes on a quarter", "varnish on a quarter", impasto.Scene([light(90, 45)]), 0),
        ("gloss out of sight", "level, varnished", impasto.Scene([light(90, 30)]), "dE:0.5"),
        ("raking, 10 degrees", "matte", impasto.Scene([light(180, 10)], shadows=True), 0),
        (
            "slanted",
            "varnish on a quarter",
            impasto.Scene([light(90, 45)], view=(0.5, 0.0, 0.87)),
            0,
        ),
    ]


def planned_against_forced(size: int) -> list[dict[str, Any]]:
    made, rows = surfaces(size), []
    for name, kind, scene, tolerance in scenes():
        plan = impasto.plan(made[kind], scene, tolerance=tolerance, threads=1)
        forced = plan.forced()
        found = plan.verify(threads=1)
        all_of_it = shortest(lambda forced=forced: forced.render(threads=1))
        seconds = shortest(lambda plan=plan: plan.render(threads=1))
        off = [e.name for e in plan.effects if e.decision in {"no-op", "bounded"}]
        partly = [
            f"{e.name} in {e.tiles}/{plan.tiles}"
            for e in plan.effects
            if e.decision == "on" and e.tiles < plan.tiles
        ]
        rows.append(
            {
                "scene": name,
                "tolerance": str(tolerance),
                "left out": ", ".join(off + partly) or "nothing",
                "forced, ms": round(1e3 * all_of_it, 1),
                "planned, ms": round(1e3 * seconds, 1),
                "times faster": round(all_of_it / seconds, 2),
                "largest": round(found.delta_e, 4),
                "bound": round(plan.error, 3),
                "same bits": "yes" if found.equal else "no",
            }
        )
    return rows


def planning() -> list[dict[str, Any]]:
    made = []
    for side in (256, 1024, 3072):
        normal = np.zeros((3, side, side), np.float32)
        normal[2] = 1.0
        diffuse = np.full((1, side, side), 0.5, np.float32)
        surface = impasto.Surface.torrance_sparrow(normal, diffuse, 0.5, 0.1)
        scene = impasto.Scene([light(90, 30)])
        made.append((impasto.plan(surface, scene, tolerance="dE:0.5", threads=1), scene))
    # In turns: what else the machine does disturbs all of them alike.
    least = [math.inf] * len(made)
    for _ in range(400):
        for which, (plan, scene) in enumerate(made):
            again = shortest(lambda plan=plan, scene=scene: plan.with_scene(scene), 1)
            least[which] = min(least[which], again)
    rows = [
        {"tiles": plan.tiles, "ms": round(1e3 * again, 3)}
        for (plan, _), again in zip(made, least, strict=True)
    ]
    first, last = rows[0], rows[-1]
    per_tile = (last["ms"] - first["ms"]) / (last["tiles"] - first["tiles"])
    rows.append({"tiles": 15259, "ms": round(first["ms"] + 15258 * per_tile, 2)})
    return rows


def saved(size: int) -> list[dict[str, Any]]:
    """Reading results of a fit, and the statistics of their maps."""
    painting = simulate.painting(size=(size, size), varnish="satin")
    lights = [light(azimuth, 45) for azimuth in range(0, 360, 45)] + [light(0, 90)]
    rig = impasto.Rig(lights, pitch_mm=painting.pitch_mm)
    fitted = impasto.fit_sbrdf(simulate.capture(painting, rig, "rgb").stack, pooling="painting")
    prepared = impasto.plan(fitted, impasto.Scene([light(90, 30)]))._prepared
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fit.npz"
        fitted.save(path)
        read = shortest(lambda: impasto.load_sbrdf(path), 9)
    statistics = shortest(
        lambda: impasto._core.SurfaceStatistics(prepared.surface, prepared.relief, 1), 9
    )
    megapixels = size * size / 1e6
    return [
        {"what": what, "ms": round(1e3 * seconds / megapixels, 1)}
        for what, seconds in (("reading a result", read), ("statistics of its maps", statistics))
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--saved", action="store_true", help="only what reading results takes")
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    if options.saved:
        rows = saved(options.size)
        show("Milliseconds per megapixel", rows)
        if options.record:
            info = run_info(
                f"python benches/python/plans.py --saved --size {options.size} --record"
            )
            write("statistics.json", {"run": info, "rows": rows})
        return
    rows, times = planned_against_forced(options.size), planning()
    show("Planned against forced", rows)
    show("Planning, statistics at hand (the last line extrapolates)", times)
    if options.record:
        info = run_info(f"python benches/python/plans.py --size {options.size} --record")
        write("plans.json", {**info, "pictures": rows, "planning": times})


if __name__ == "__main__":
    main()
