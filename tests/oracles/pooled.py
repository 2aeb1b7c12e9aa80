"""One (beta, gamma) for all pixels, by SciPy in float64, written from eq. 6 and 10 of the papers.

Three estimates of a small noisy scene, none sharing a line with the package:

``separate``
    eq. 6 / 10 on undivided data, normals and colours known: MINPACK's ``lmder`` over every sample.
``joint_least_squares``
    eq. 1 / 9 in full: beta, gamma, every normal and every colour by sparse trust region.
``joint_robust``
    the same unknowns, minimising the product over the pixels of ``s^2 + g`` with the grain g of
    ``docs/models.md`` and their M-scales s, defined for a pixel with residual vectors r_i (one per
    photograph, all bands) by
    ``mean_i rho(|r_i|^2 / (bands v_i s^2)) = 1/4``, ``rho(v) = v / (1 + v)``, with variances
    ``v_i = y_i / m + 1/10`` for photographs of brightness y_i and mean brightness m: iterated
    weighted least squares until nothing moves.

Run it (some seconds) to print the numbers that ``EXPECTED`` holds (SciPy 1.17, numpy 2.4).
"""

from __future__ import annotations

import sys

import numpy as np

SHAPE = (10, 12)
BETA, GAMMA = 11.0, 0.13
NOISE = 8e-3
"""Of a sample of 1; its variance is proportional to the light."""

BANDS = 3

EXPECTED: dict[str, tuple[float, float]] = {
    "separate": (10.984138, 0.13012909),
    "joint_least_squares": (10.975654, 0.13034205),
    "joint_robust": (10.97802, 0.13024429),
}
"""Estimate to (beta, gamma)."""

DEVIATIONS = (0.001168, 0.0009511)
"""Standard deviations of log beta and log gamma of ``joint_least_squares``, from its J'J."""


def lights():
    """16 directions: 8 at 45 degrees elevation, 8 at 67.5, staggered."""
    ring = np.arange(8) * np.pi / 4
    low, high = np.radians(45.0), np.radians(67.5)
    directions = [(np.cos(a) * np.cos(low), np.sin(a) * np.cos(low), np.sin(low)) for a in ring]
    ring = ring + np.pi / 8
    directions += [(np.cos(a) * np.cos(high), np.sin(a) * np.cos(high), np.sin(high)) for a in ring]
    return np.array(directions)


def unit(slopes):
    """``(3, pixels)`` normals from two slopes."""
    normal = np.vstack([slopes, np.ones(slopes.shape[1])])
    return normal / np.linalg.norm(normal, axis=0)


def model(slopes, colours, beta, gamma):
    """Eq. 1 / 9: samples ``(light, band, pixel)``, diffuse part and lobe ``(light, pixel)``."""
    n, towards, view = unit(slopes), lights(), np.array([0.0, 0.0, 1.0])
    half = towards + view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    n_l, n_h, n_v = towards @ n, half @ n, view @ n
    v_h = half @ view
    phi = np.arccos(np.clip(n_h, -1.0, 1.0))
    sin_t = np.sqrt(1.0 - v_h**2) / 1.45
    cos_t = np.sqrt(1.0 - sin_t**2)
    r_s = (v_h - 1.45 * cos_t) / (v_h + 1.45 * cos_t)
    r_p = (1.45 * v_h - cos_t) / (1.45 * v_h + cos_t)
    fresnel = (r_s**2 + r_p**2)[:, None] / 2
    groove = np.minimum(1.0, np.minimum(2 * n_h * n_v, 2 * n_h * n_l) / v_h[:, None])
    lobe = fresnel * groove / n_v * np.exp(-np.log(2.0) * phi**2 / gamma**2)
    lobe = np.where((n_l > 0) & (n_v > 0), lobe, 0.0)
    diffuse = np.maximum(n_l, 0.0)[:, None] * colours
    return diffuse + beta * lobe[:, None], diffuse, lobe


def scene(noise=NOISE):
    """Slopes ``(2, pixels)``, colours ``(band, pixel)``, samples ``(light, band, pixel)``."""
    rng = np.random.default_rng(20)
    pixels = SHAPE[0] * SHAPE[1]
    slopes = rng.normal(0.0, 0.17, (2, pixels))
    colours = rng.uniform(0.1, 0.7, (BANDS, pixels))
    clean = model(slopes, colours, BETA, GAMMA)[0]
    return slopes, colours, clean + noise * np.sqrt(clean) * rng.standard_normal(clean.shape)


def separate():
    """Normals and colours known: two unknowns."""
    from scipy.optimize import least_squares

    slopes, colours, samples = scene()

    def residuals(p):
        predicted, diffuse, _ = model(slopes, colours, p[0], p[1])
        counts = samples.mean(axis=1) >= 0.5 * diffuse.mean(axis=1)
        return ((samples.mean(axis=1) - predicted.mean(axis=1)) * counts).ravel()

    fit = least_squares(residuals, [5.0, 0.2], method="lm", xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return tuple(fit.x)


def _sparsity(pixels):
    from scipy.sparse import lil_array

    rows = len(lights()) * BANDS * pixels
    pattern = lil_array((rows, 2 + (2 + BANDS) * pixels), dtype=np.int8)
    place = np.arange(rows)
    pixel, band = place % pixels, place // pixels % BANDS
    pattern[:, :2] = 1
    for k in (0, 1):
        pattern[place, 2 + k * pixels + pixel] = 1
    pattern[place, 2 + (2 + band) * pixels + pixel] = 1
    return pattern.tocsr()


def _fit(samples, weights, start, sparsity):
    from scipy.optimize import least_squares

    pixels = samples.shape[2]

    def residuals(p):
        slopes = p[2 : 2 + 2 * pixels].reshape(2, pixels)
        colours = p[2 + 2 * pixels :].reshape(BANDS, pixels)
        return ((samples - model(slopes, colours, p[0], p[1])[0]) * weights).ravel()

    options = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12, "x_scale": "jac"}
    return least_squares(residuals, start, jac="3-point", jac_sparsity=sparsity, **options)


def joint_least_squares():
    """All unknowns, every sample alike; also the standard deviations of the first two."""
    slopes, colours, samples = scene()
    start = np.concatenate([[BETA, GAMMA], slopes.ravel(), colours.ravel()])
    fit = _fit(samples, 1.0, start, _sparsity(samples.shape[2]))
    matrix = np.linalg.inv((fit.jac.T @ fit.jac).toarray())
    variance = 2 * fit.cost / (samples.size - fit.x.size)
    return fit.x, np.sqrt(variance * np.diag(matrix)[:2]) / fit.x[:2]


def _level(scale, squares):
    """What the squared scale makes vanish."""
    return np.mean(squares / (squares + scale)) - 0.25


def joint_robust(start):
    """All unknowns, smallest M-scales."""
    from scipy.optimize import brentq

    samples = scene()[2]
    pixels = samples.shape[2]
    sparsity = _sparsity(pixels)
    for _ in range(60):
        slopes = start[2 : 2 + 2 * pixels].reshape(2, pixels)
        colours = start[2 + 2 * pixels :].reshape(BANDS, pixels)
        residuals = samples - model(slopes, colours, start[0], start[1])[0]
        light = np.maximum(samples.mean(axis=1), 0.0)
        trust = 1.0 / (light / light.mean(axis=0) + 0.1)
        squares = (residuals**2).mean(axis=1) * trust
        scales = np.array(
            [brentq(_level, 1e-9, 1.0, args=(s,), xtol=1e-18, rtol=1e-14) for s in squares.T]
        )
        order = np.argsort(scales)
        light = np.cumsum(colours.sum(axis=0)[order])
        grain = scales[order][np.searchsorted(light, light[-1] / 4)] / 4
        weight = (scales / (squares + scales)) ** 2
        # d log(s^2 + g) = s^2 / (s^2 + g) 2 sum(w r dr) / sum(w r^2).
        share = scales / (scales + grain) / (weight * squares).sum(axis=0)
        weights = np.sqrt(weight * trust * share)
        before = start[:2]
        start = _fit(samples, weights[:, None], start, sparsity).x
        if np.abs(start[:2] / before - 1.0).max() < 1e-8:
            break
    return tuple(start[:2])


if __name__ == "__main__":
    joint, deviations = joint_least_squares()
    numbers = {
        "separate": separate(),
        "joint_least_squares": tuple(joint[:2]),
        "joint_robust": joint_robust(joint),
    }
    for name, (beta, gamma) in numbers.items():
        sys.stdout.write(f'    "{name}": ({beta:.8g}, {gamma:.8g}),\n')
    sys.stdout.write(f"DEVIATIONS = ({deviations[0]:.4g}, {deviations[1]:.4g})\n")
