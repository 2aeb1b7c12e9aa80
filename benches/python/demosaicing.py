"""What the mosaic of a camera's sensor costs, by the algorithm that interpolates it.

    python benches/python/demosaicing.py [--record]

Simulated paintings of 160 x 160 pixels under 16 lamps, 14 bits, seen through a Bayer mosaic (DNG)
and developed by LibRaw: mean error of the normals of photometric stereo in degrees, mean difference
of the albedo from that of photographs without a mosaic in per cent, and rms difference of the
samples in per cent of their mean. The border of eight pixels does not count.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import rawpy
from numpy.typing import NDArray
from record import run_info, show, write
from rigs import dome

import impasto
from impasto import simulate
from impasto.io.images import raw, read_image

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from raw_files import mosaic_of, write_dng

SIDE, LIGHTS, EDGE = 160, 16, 8
PAINTINGS = ("satin", "none")
ALGORITHMS = ("LINEAR", "AHD", "PPG", "VNG", "DCB", "DHT", "AAHD")
INNER = np.s_[..., EDGE:-EDGE, EDGE:-EDGE]


def photographs(varnish: str) -> tuple[NDArray[np.float64], impasto.Rig, NDArray[np.float32]]:
    """Linear light ``(obs, 3, y, x)`` up to 1, the rig and the true normals."""
    kind: Any = None if varnish == "none" else varnish
    painting = simulate.painting(0, (SIDE, SIDE), varnish=kind, pitch_mm=0.1)
    lights = [impasto.DistantLight((*one,), 0.5) for one in dome(LIGHTS).tolist()]
    rig = impasto.Rig(lights, pitch_mm=0.1)
    taken = simulate.capture(painting, rig, "rgb", encoding="linear", bits=14, exposure=0.5).stack
    light = taken.samples * np.asarray(taken.scale).reshape(-1, 1, 1)
    return light / light.max(), rig, painting.surface().normal


def fitted(samples: NDArray[np.uint16], rig: impasto.Rig) -> impasto.Normals:
    return impasto.fit_normals(
        impasto.Stack(samples, lights=rig, scale=1 / 65535, saturation=65535)
    )


def developed(light: NDArray[np.float64], folder: Path) -> NDArray[np.uint16]:
    found = []
    for one in light:
        write_dng(folder / "one.dng", mosaic_of(one))
        found.append(read_image(folder / "one.dng"))
    return np.stack(found)


def rows_of(varnish: str, folder: Path) -> list[dict[str, Any]]:
    light, rig, truth = photographs(varnish)
    whole = fitted(np.rint(light * 65535).astype(np.uint16), rig)

    def row(name: str, samples: NDArray[Any], found: impasto.Normals) -> dict[str, Any]:
        cosine = np.clip(np.sum(found.normal * truth, axis=0)[INNER], -1.0, 1.0)
        colours = np.abs(found.albedo - whole.albedo)[INNER]
        difference = (samples / 65535 - light)[INNER]
        return {
            "varnish": varnish,
            "algorithm": name,
            "normals deg": float(np.degrees(np.nanmean(np.arccos(cosine)))),
            "albedo %": float(100 * np.nanmean(colours) / np.nanmean(whole.albedo[INNER])),
            "samples %": float(100 * np.sqrt(np.mean(difference**2)) / light[INNER].mean()),
        }

    rows = [row("no mosaic", light * 65535, whole)]
    for name in ALGORITHMS:
        raw.DEMOSAICING = rawpy.DemosaicAlgorithm[name].name
        samples = developed(light, folder)
        rows.append(row(name, samples, fitted(samples, rig)))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rows = [row for varnish in PAINTINGS for row in rows_of(varnish, Path(name))]
    show("demosaicing", rows)
    if options.record:
        run = run_info("benches/python/demosaicing.py --record")
        libraw = ".".join(map(str, rawpy.libraw_version))
        write("demosaicing.json", {"run": run, "libraw": libraw, "rows": rows})


if __name__ == "__main__":
    main()
