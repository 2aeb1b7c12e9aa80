"""Overexposed highlights: left out, as measured, reconstructed, censored.

    python benches/python/clipping.py [--seeds N] [--record]

Simulated photographs of a glossy relief under 16 or 60 lamps (``tests/oracles/forward.py``, plain
numpy from the papers), with noise of 0.2 % of a white board. Green clips first, blue last, as in
Snel's figure 13: blue takes three times the light, red one and a half times. Four ways to treat
clipped samples, in a fit of one lobe for the painting and of lobes for each pixel:

left out: NaN in every clipped band, by ``impasto.leave_out_highlights``;
as measured: a clipped sample counts as what was measured;
reconstructed: ``impasto.reconstruct_highlights``, the method of Snel's figures 14 and 15;
censored: the default, the stack knows from which code samples are clipped.

CIEDE2000 with bands as linear sRGB: ``paint`` of the diffuse colours, ``highlights`` of the light
that the fit predicts where a band was clipped, ``samples`` of what was fitted there, all against
photographs without noise and clipping; white is the brightest one per mille of these for the last
two. Errors of beta and gamma in %, the worst of the seeds. ``--record`` writes
benches/results/clipping.json, the tables of docs/clipping.md and its picture.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write

import impasto
from impasto.colour import delta_e, lab_from_xyz
from impasto.io import write_jpeg
from impasto.pictures import colour_panel, contact_sheet

sys.path.insert(0, str(ROOT / "tests"))

from oracles import forward, rigs

SIZE = 32
SHOWN = 128
LAMPS = (16, 60)
NOISE = 0.002
LEVELS = np.array([1.5, 1.0, 3.0]) * 0.6
"""Light from which red, green and blue are clipped; paint reads 0.5 at most."""
GAMMA = 0.12
PEAK = 2.0
"""beta times Fresnel's reflectance: highlights reach three times the light of white paint."""
SRGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""IEC 61966-2-1: XYZ of linear red, green and blue."""
CASES = {
    "grey paint, white gloss": ((0.3, 0.3, 0.3), (1.0, 1.0, 1.0), 0.0),
    "paints, white gloss": ((0.3, 0.25, 0.2), (1.0, 1.0, 1.0), 0.2),
    "blue paint, golden gloss": ((0.05, 0.1, 0.4), (1.44, 1.11, 0.45), 0.02),
    "gold": ((0.02, 0.015, 0.005), (1.44, 1.11, 0.45), 0.0),
}
"""Mean colour of the paint, colour of the gloss, and how much paint colours vary."""


@dataclass(frozen=True)
class Scene:
    """Truth and photographs: light (obs, band, y, x) without and with noise and clipping."""

    diffuse: np.ndarray
    light: np.ndarray
    seen: np.ndarray
    lamps: np.ndarray

    @property
    def clipped(self) -> np.ndarray:
        """(obs, band, y, x)."""
        return self.seen >= LEVELS.astype(np.float32)[:, None, None]


def scene(case: str, seed: int, count: int, size: int = SIZE) -> Scene:
    """Photographs of one case under some lamps."""
    paint, gloss, vary = CASES[case]
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size] / size
    phase = rng.uniform(0, 2 * np.pi, 8)
    slope = [0.1 * np.sin(8 * a + 5 * b + p) for a, b, p in ((x, y, phase[0]), (y, -x, phase[1]))]
    normal = np.stack([*slope, np.ones_like(x)])
    normal /= np.linalg.norm(normal, axis=0)
    waves = [np.sin((4 + k) * x + (6 - k) * y + phase[2 + k]) for k in range(3)]
    diffuse = np.array([p + vary * w for p, w in zip(paint, waves, strict=True)]).clip(0.01, 0.5)
    lamps, view = rigs.spiral(count), np.array([0.0, 0.0, 1.0])
    nothing = np.zeros_like(diffuse[:1])
    light = np.array(
        [
            forward.radiance(normal, diffuse, 0.0, GAMMA, lamp, view)
            + np.array(gloss)[:, None, None]
            * forward.radiance(normal, nothing, PEAK / forward.fresnel(0.0), GAMMA, lamp, view)
            for lamp in lamps
        ]
    )
    seen = np.minimum(light + rng.normal(0, NOISE, light.shape), LEVELS[:, None, None])
    return Scene(diffuse, light, seen.astype(np.float32), lamps)


def left_out(made: Scene) -> impasto.Stack:
    """Clipped bands are missing."""
    return impasto.leave_out_highlights(censored(made))


def as_measured(made: Scene) -> impasto.Stack:
    """Nobody knows that samples are clipped."""
    return impasto.Stack(made.seen, lights=made.lamps)


def censored(made: Scene) -> impasto.Stack:
    """The stack knows."""
    return impasto.Stack(made.seen, lights=made.lamps, saturation=LEVELS)


def reconstructed(made: Scene) -> impasto.Stack:
    """Clipped bands from the others, by the colour of the brightest whole sample."""
    return impasto.reconstruct_highlights(censored(made))


WAYS: dict[str, Callable[[Scene], impasto.Stack]] = {
    "left out": left_out, "as measured": as_measured, "reconstructed": reconstructed,
    "censored": censored,
}  # fmt: skip


def apart(light: np.ndarray, truth: np.ndarray, white: float) -> float:
    """Mean CIEDE2000 of ``(band, n)`` linear sRGB."""
    labs = [lab_from_xyz(SRGB @ np.maximum(one, 0.0) / white) for one in (light, truth)]
    return float(np.nanmean(delta_e(*labs)))


def measured(made: Scene, way: str, pooling: Any) -> dict[str, float | None]:
    """Errors of one fit."""
    stack = WAYS[way](made)
    found = impasto.fit_sbrdf(stack, pooling=pooling, refine=False)
    where = made.clipped.any(axis=1)
    white = float(np.quantile(made.light.mean(axis=1), 0.999))

    def at(light: np.ndarray) -> np.ndarray:
        return np.moveaxis(light, 1, 0)[:, where]

    samples = None
    if way in {"as measured", "reconstructed"}:
        fitted = np.array([stack.linear(i) for i in range(len(made.lamps))])
        known = np.isfinite(at(fitted)).all(axis=0)
        samples = apart(at(fitted)[:, known], at(made.light)[:, known], white)
    predicted = np.asarray(found.predict(stack.rig), np.float64)
    gloss = PEAK / forward.fresnel(0.0)
    return {
        "samples": samples,
        "highlights": apart(at(predicted), at(made.light), white),
        "paint": apart(found.diffuse.reshape(3, -1), made.diffuse.reshape(3, -1), 1.0),
        "beta": 100.0 * (found.gloss.beta / gloss - 1.0),
        "gamma": 100.0 * (found.gloss.gamma / GAMMA - 1.0),
    }


def rows(seeds: int) -> list[dict[str, Any]]:
    """One row for each case, fit and way."""
    table = []
    for case, count in ((case, count) for case in CASES for count in LAMPS):
        made = [scene(case, seed, count) for seed in range(seeds)]
        share = 100.0 * float(np.mean([one.clipped.any(axis=1).mean() for one in made]))
        # One lobe for the painting has no colour.
        white = CASES[case][1] == (1.0, 1.0, 1.0)
        for pooling in ("painting", "pixel") if white else ("pixel",):
            for way in WAYS:
                each = [measured(one, way, pooling) for one in made]
                row: dict[str, Any] = {
                    "case": case, "lamps": count, "clipped": share, "fit": pooling, "way": way,
                }  # fmt: skip
                for key in each[0]:
                    values = [one[key] for one in each]
                    if None in values:
                        row[key] = None
                    elif key in {"beta", "gamma"}:
                        row[key] = max(values, key=abs)
                    else:
                        row[key] = float(np.mean(values))
                table.append(row)
    return table


def picture() -> np.ndarray:
    """A photograph of the paints, clipped in some bands: Snel's figure 15, with the truth."""
    made = scene("paints, white gloss", 0, LAMPS[-1], SHOWN)
    some, every = made.clipped.any(axis=1), made.clipped.all(axis=1)
    index = int((some.mean(axis=(1, 2)) - 10.0 * every.mean(axis=(1, 2))).argmax())
    whole = reconstructed(made).linear(index)
    seen = made.seen[index]
    whole = np.where(np.isfinite(whole), whole, np.float32(np.nan))
    white = float(np.quantile(made.light[index], 0.99))
    return contact_sheet(
        [
            colour_panel(seen, "Original", note="bands clipped one by one", white=white),
            colour_panel(np.minimum(seen, LEVELS.min()), "Clamped to white", white=white),
            colour_panel(whole, "Reconstructed", white=white),
            colour_panel(made.light[index], "Truth", white=white),
        ],
        columns=4,
        width=300,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=3, help="paintings per row")
    parser.add_argument("--record", action="store_true", help="write benches/results/clipping.json")
    options = parser.parse_args()
    found = rows(options.seeds)
    show("clipped highlights: dE00, errors of beta and gamma in %", found)
    if options.record:
        command = f"python benches/python/clipping.py --seeds {options.seeds} --record"
        print(f"\nwrote {write('clipping.json', {'run': run_info(command), 'rows': found})}")
        set_tables(ROOT / "docs" / "clipping.md")
        write_jpeg(ROOT / "docs" / "_static" / "clipping.jpg", picture(), quality=88)


if __name__ == "__main__":
    main()
