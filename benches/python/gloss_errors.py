"""Whether the predicted errors of the gloss are as large as the errors.

    python benches/python/gloss_errors.py [--record]

Simulated paintings of one varnish, 64 x 64 pixels, under spirals of 16, 24 and 49 lamps in three
bands with the noise of a sensor. For each kind of varnish and number of lamps the 68 % quantile of
what is found less what is true, over the predicted standard deviation: 1 where that is right. One
lobe for the painting: ln beta and ln gamma over ``covariance``, a number per painting. Lobes per
pixel: ln gamma over ``gamma_sigma``, where a pixel has the one lobe that it should. ``--record``
writes benches/results/gloss_errors.json and sets the table of docs/numerics.md.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write

import impasto
from impasto import simulate

SIZE = (64, 64)
LAMPS = (16, 24, 49)
POOLED, PIXEL = ("satin", "gloss"), ("matte", "satin", "gloss")
PAINTINGS = {"painting": 10, "pixel": 3}
SHARE = 0.6827
"""What a normal distribution has within one standard deviation to either side."""


def spiral(count: int) -> impasto.Rig:
    """Lamps in equal steps of height, each a golden angle further."""
    azimuth = np.arange(count) * np.pi * (3 - np.sqrt(5))
    z = np.linspace(0.95, 0.3, count)
    ground = np.sqrt(1 - z**2)
    return impasto.Rig(np.stack([np.cos(azimuth) * ground, np.sin(azimuth) * ground, z], 1))


def taken(varnish: str, lamps: int, seed: int) -> simulate.Capture:
    """Photographs, and the surface that they show."""
    painting = simulate.painting(seed, SIZE, varnish=varnish)
    return simulate.capture(painting, spiral(lamps), "rgb", seed=seed)


def of_painting(varnish: str, lamps: int, seed: int) -> tuple[float, float]:
    """Deviations of ln beta and ln gamma of the painting's lobe."""
    shown = taken(varnish, lamps, seed)
    found = impasto.fit_sbrdf(shown.stack, pooling="painting", coated=False, threads=1)
    truth = shown.truth.painting
    off = np.log([found.beta / np.median(truth.beta), found.gamma / np.median(truth.gamma)])
    return tuple((off / np.sqrt(np.diag(found.covariance))).tolist())


def of_pixels(varnish: str, lamps: int, seed: int) -> np.ndarray:
    """Deviations of ln gamma of the pixels with one lobe of their own."""
    shown = taken(varnish, lamps, seed)
    found = impasto.fit_sbrdf(
        shown.stack, pooling="pixel", coated=False, residuals=False, threads=1
    )
    own = (found.lobes == 1) & (found.status == impasto.Status.FITTED)
    off = np.log(found.gamma[0] / shown.truth.painting.gamma[0]) / found.gamma_sigma[0]
    return np.asarray(off[own])


def quantile(values: Any) -> float:
    """The 68 % quantile of their sizes; not finite ones were not predicted at all."""
    sizes = np.abs(np.asarray(values, dtype=np.float64))
    return float(np.quantile(sizes[np.isfinite(sizes)], SHARE))


def rows() -> list[dict[str, Any]]:
    """A row for each varnish and number of lamps."""
    found = []
    for varnish in PIXEL:
        for lamps in LAMPS:
            row: dict[str, Any] = {"varnish": varnish, "lamps": lamps, "beta": None, "gamma": None}
            if varnish in POOLED:
                pairs = [of_painting(varnish, lamps, 1 + i) for i in range(PAINTINGS["painting"])]
                row |= dict(
                    zip(("beta", "gamma"), map(quantile, zip(*pairs, strict=True)), strict=True)
                )
            pixels = [of_pixels(varnish, lamps, 1 + i) for i in range(PAINTINGS["pixel"])]
            row["pixel"] = quantile(np.concatenate(pixels))
            found.append(row)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    table = rows()
    show("68 % quantile over the predicted deviation", table)
    if options.record:
        run = run_info("python benches/python/gloss_errors.py --record")
        write("gloss_errors.json", {"run": run, "rows": table})
        set_tables(ROOT / "docs" / "numerics.md")


if __name__ == "__main__":
    main()
