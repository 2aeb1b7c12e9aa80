"""A plain-weave canvas, sized and primed."""

from __future__ import annotations

import numpy as np

from impasto.simulate.fields import Field, blur, fractal, noise


def weave(
    rng: np.random.Generator, shape: tuple[int, int], pitch_mm: float, thread_mm: float
) -> Field:
    """Height of a plain weave in mm, ``(y, x)``.

    Warp and weft pass over each other in turn. Threads wander, and each has its own thickness
    that changes along it (slubs), as in hand-spun linen.
    """
    thread = thread_mm / pitch_mm
    rows = np.arange(shape[0], dtype=np.float32)[:, None]
    columns = np.arange(shape[1], dtype=np.float32)[None, :]
    wander = 0.16 * thread
    x = columns + wander * fractal(rng, shape, (14 * thread, 5 * thread), 3)
    y = rows + wander * fractal(rng, shape, (5 * thread, 14 * thread), 3)
    warp_at, weft_at = np.floor(x / thread), np.floor(y / thread)
    # Across a thread: a circular section. Along it: over one neighbour, under the next.
    across_warp = np.sqrt(np.clip(1.0 - (2.0 * (x / thread - warp_at) - 1.0) ** 2, 0.0, 1.0))
    across_weft = np.sqrt(np.clip(1.0 - (2.0 * (y / thread - weft_at) - 1.0) ** 2, 0.0, 1.0))
    phase = np.pi * (y / thread + warp_at)
    phase_weft = np.pi * (x / thread + weft_at + 1.0)
    slub_warp = 1.0 + 0.22 * noise(rng, shape, (24 * thread, 1.0 * thread))
    slub_weft = 1.0 + 0.22 * noise(rng, shape, (1.0 * thread, 24 * thread))
    warp = slub_warp * across_warp * (0.62 + 0.38 * np.sin(phase))
    weft = slub_weft * across_weft * (0.62 + 0.38 * np.sin(phase_weft))
    radius_mm = 0.16 * thread_mm
    return np.asarray(radius_mm * np.maximum(warp, weft), dtype=np.float32)


def primed(rng: np.random.Generator, height: Field, pitch_mm: float, thread_mm: float) -> Field:
    """The weave under two coats of ground, brushed on: valleys fill, crests stay; mm."""
    softened = blur(height, 0.17 * thread_mm / pitch_mm)
    filled = blur(softened, 0.55 * thread_mm / pitch_mm)
    ground = softened + 0.45 * np.maximum(filled - softened, 0.0)
    brushed = 0.004 * noise(rng, height.shape, (0.5 / pitch_mm, 9.0 / pitch_mm))
    return np.asarray(ground + brushed - ground.mean(), dtype=np.float32)
