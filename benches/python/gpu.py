"""Frames per second of the GPU renderer against the CPU's, encoding to 8 bits included.

    python benches/python/gpu.py [--record] [--adapter NAME] [--side PIXELS]

The surface is on the card, and the lamp moves from frame to frame, as in a viewer. Both renderers
return display codes in the CPU's memory. The CPU has all cores. The least time of several rounds,
in turn.

`--record` writes benches/results/gpu.json: what it has of this card and this size, anew.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from record import RESULTS, run_info, show, write

import impasto
from impasto import DistantLight, Environment, Scene, Surface, gpu

ROUNDS = 15
FRAMES = 4


def paintings(side: int) -> dict[str, Surface]:
    """The same relief and colours with more and more lobes."""
    rng = np.random.default_rng(0)
    size = (side, side)
    normal = rng.normal(0.0, 0.1, (3, *size))
    normal[2] = 1.0
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    diffuse = rng.uniform(0.0, 0.5, (3, *size)).astype(np.float32)
    beta, gamma = rng.uniform(0.5, 4.0, size), rng.uniform(0.05, 0.3, size)
    matte = Surface(normal, diffuse)
    psi = rng.uniform(-0.3, 0.3, (3, *size))
    specular = rng.uniform(0.0, 0.2, (3, 3, *size))
    exponent = rng.uniform(3.0, 60.0, (3, *size))
    cxy, cz = np.sin(psi) - np.cos(psi), np.sin(psi) + np.cos(psi)
    relief = np.cumsum(rng.normal(0.0, 0.02, size), axis=0).astype(np.float32)
    return {
        "diffuse": matte,
        "Torrance-Sparrow": Surface.torrance_sparrow(normal, diffuse, beta, gamma),
        "Torrance-Sparrow, one for all": Surface.torrance_sparrow(normal, diffuse, 2.0, 0.1),
        "3 Lafortune lobes": Surface.lafortune(normal, diffuse, specular, cxy, cz, exponent),
        "diffuse, cast shadows": replace(matte, height=relief),
    }


def scenes(*, shadows: bool, radius: float = 0.0, room: bool = False) -> list[Scene]:
    """A lamp that turns, as large as ``radius`` says, alone or in the gallery."""
    angles = np.linspace(0.1, 5.9, FRAMES)
    lamps = [DistantLight((np.cos(a), np.sin(a), 0.8), radius=radius) for a in angles]
    around = Environment.named("gallery") if room else None
    return [
        Scene([lamp], environment=around, shadows=shadows, exposure=0.5 if room else 0.8)
        for lamp in lamps
    ]


def cases(side: int) -> Iterator[tuple[str, Surface, list[Scene]]]:
    """Surfaces and the scenes in which they are shown."""
    surfaces = paintings(side)
    for name, surface in surfaces.items():
        yield name, surface, scenes(shadows=surface.height is not None)
    glossy = "Torrance-Sparrow, one for all"
    for what, options in (("a lamp of 6 degrees", {"radius": 0.05}), ("a gallery", {"room": True})):
        yield f"{glossy}, {what}", surfaces[glossy], scenes(shadows=False, **options)


def least(contenders: dict[str, Callable[[Scene], Any]], views: list[Scene]) -> dict[str, float]:
    """Seconds of a frame, the contenders taking turns."""
    found = dict.fromkeys(contenders, np.inf)
    for _ in range(ROUNDS):
        for name, contender in contenders.items():
            start = time.perf_counter()
            for scene in views:
                contender(scene)
            found[name] = min(found[name], (time.perf_counter() - start) / len(views))
    return found


def measured(adapter: str, side: int) -> list[dict[str, Any]]:
    """A row for each surface."""
    rows = []
    for name, surface, views in cases(side):
        shadows = surface.height is not None
        renderer = gpu.Renderer(surface, shadows=shadows, adapter=adapter)
        on_card = renderer.frame
        on_cpu = drawn_by_cpu(surface)
        difference = max(
            int(np.abs(on_card(v).display.astype(int) - on_cpu(v)).max()) for v in views
        )
        seconds = least({"cpu": on_cpu, "gpu": on_card}, views)
        rows.append(
            {
                "surface": name,
                "cpu_fps": 1.0 / seconds["cpu"],
                "gpu_fps": 1.0 / seconds["gpu"],
                "ratio": seconds["cpu"] / seconds["gpu"],
                "codes_apart": difference,
            }
        )
    return rows


def drawn_by_cpu(surface: Surface) -> Callable[[Scene], Any]:
    """What a frame of the CPU takes: codes of its own renderer, with all there is simulated."""

    def frame(scene: Scene) -> Any:
        return impasto.render(surface, scene, fidelity="model").display

    return frame


def recorded(run: dict[str, Any]) -> None:
    """Put what was measured into the record, in the place of the same card and size."""
    path = RESULTS / "gpu.json"
    runs = json.loads(path.read_text("utf-8"))["runs"] if path.exists() else []
    place = run["adapter"]["name"], run["side"]
    kept = [one for one in runs if (one["adapter"]["name"], one["side"]) != place]
    runs = sorted([*kept, run], key=lambda one: (one["adapter"]["name"], one["side"]))
    table = [
        {"card": one["adapter"]["name"].partition(" (")[0], "side": one["side"], **row}
        for one in runs
        for row in one["rows"]
    ]
    write("gpu.json", {"runs": runs, "table": table})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--adapter", default="any")
    parser.add_argument("--side", type=int, default=1024)
    options = parser.parse_args()
    side = options.side
    card = gpu.Renderer(Surface(np.ones((3, 1, 1)), np.ones((1, 1, 1))), adapter=options.adapter)
    rows = measured(options.adapter, side)
    show(f"frames per second, {side} x {side}, {card.adapter.name}", rows)
    if options.record:
        command = f"python benches/python/gpu.py --record --side {side}"
        described = asdict(card.adapter)
        recorded({"run": run_info(command), "adapter": described, "side": side, "rows": rows})


if __name__ == "__main__":
    main()
