"""How near the main job comes to the truth of simulated paintings.

    python benches/python/accuracy.py [--size N] [--seeds N] [--data DIR] [--methods] [--write]

Paintings (512 x 512) are photographed by both papers' rigs with shot and read noise and 12 bits,
fitted with the defaults and compared with what they were made from; then one thing after the other
is made harder. ``--write`` records benches/results/accuracy.json and sets the tables of
docs/accuracy.md. Lower is better everywhere.

The simulator shares its forward model with the fit. Therefore one row is photographed by another
one, written in float64 numpy from the papers (tests/oracles/forward.py), and where real pigments
are at hand (``--data``), one is painted with them.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pages import set_tables
from record import RESULTS, ROOT, data_folder, run_info, show, write

import impasto
from impasto import colour, simulate
from impasto.simulate import Capture, Painting
from impasto.training import general_training

SYSTEMS = {
    "tominaga-six-band-adaptation": "16 lights, six bands",
    "tominaga-rgb-camera": "9 lights, RGB",
}
DISTANCE_MM = 500.0
"""Lamps of the near rows: five times the width of a painting of 512 pixels."""


@dataclass(frozen=True)
class Case:
    """One row: how the painting was made and how it was photographed."""

    name: str
    painting: dict[str, Any] = field(default_factory=dict)
    capture: dict[str, Any] = field(default_factory=dict)
    near: bool = False
    afterwards: Callable[[Capture], impasto.Stack] = lambda capture: capture.stack
    training: impasto.Training | None = None


def equations() -> Any:
    """tests/oracles/forward.py: the papers' equations in float64 numpy."""
    spec = importlib.util.spec_from_file_location("forward", ROOT / "tests/oracles/forward.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def independent(normal: Any, diffuse: Any, beta: Any, gamma: Any, rig: impasto.Rig) -> np.ndarray:
    """Radiance by the papers' equations."""
    return np.asarray(equations().stack(normal, diffuse, beta, gamma, rig))


def long_tailed(normal: Any, diffuse: Any, beta: Any, gamma: Any, rig: impasto.Rig) -> np.ndarray:
    """Radiance with facets that tilt as Walter et al. 2007 have it (eq. 33, GGX).

    Same height and half-width as the papers' Gaussian, but the lobe falls with the fourth power of
    the tilt: no (beta, gamma) fits it. Distant lights, one coat.
    """
    paper = equations()
    n = np.asarray(normal, np.float64)
    images = []
    for light in rig.lights:
        direction, view = np.asarray(light.direction), np.array([0.0, 0.0, 1.0])
        half = direction + view
        half /= np.linalg.norm(half)
        n_l, n_v, n_h = (np.tensordot(vector, n, 1) for vector in (direction, view, half))
        v_h = float(view @ half)
        # Half of the peak at the tilt gamma: tan^2 gamma = (sqrt 2 - 1) alpha^2, to 4th order.
        squared = np.tan(gamma[0].astype(np.float64)) ** 2 / (np.sqrt(2.0) - 1.0)
        tangent = 1.0 / np.maximum(n_h, 1e-6) ** 2 - 1.0
        facets = (squared / (squared + tangent)) ** 2 / np.maximum(n_h, 1e-6) ** 4
        shading = np.minimum(1.0, np.minimum(2 * n_h * n_v / v_h, 2 * n_h * n_l / v_h))
        specular = beta[0] * facets * shading * paper.fresnel(np.arccos(v_h)) / n_v
        seen = (n_l > 0) & (n_v > 0)
        radiance = diffuse * np.maximum(n_l, 0.0) + np.where(seen, specular, 0.0)
        images.append(radiance * light.intensity)
    return np.array(images)


def taken_for_distant(capture: Capture) -> impasto.Stack:
    """The photographs with their lamps' directions only, as a light file without distances."""
    stack = capture.stack
    lights = [impasto.DistantLight(one.direction, one.intensity) for one in stack.rig.lights]
    return rerigged(stack, stack.samples, lights)


def decoded_as(curve: str) -> Callable[[Capture], impasto.Stack]:
    """Photographs coded as sRGB and read with another curve; the white board is read likewise."""

    def read(capture: Capture) -> impasto.Stack:
        stack = capture.stack
        wrong = impasto.Encoding(curve, stack.encoding.white)
        samples = wrong.decode(stack.encoding.encode(stack.samples))
        lights = [
            replace(one, intensity=float(wrong.decode(stack.encoding.encode(one.intensity))))
            for one in stack.rig.lights
        ]
        return rerigged(stack, samples, lights)

    return read


def rerigged(stack: impasto.Stack, samples: np.ndarray, lights: list[Any]) -> impasto.Stack:
    rig = impasto.Rig(lights, views=stack.rig.views, pitch_mm=stack.rig.pitch_mm)
    return impasto.Stack(
        samples, lights=rig, bands=stack.bands, saturation=stack.saturation,
        scale=stack.scale, black=stack.black, encoding=stack.encoding,
    )  # fmt: skip


CLEAN = {"noise": False, "bits": None, "clip": False}
CODED = {"encoding": "srgb", "bits": 8}
CASES = [
    Case("satin varnish, as photographed"),
    Case("the same by an independent forward model", capture={"forward": independent}),
    Case("no noise, no rounding, nothing clipped", capture=CLEAN),
    Case("a lobe with long tails (GGX)", capture={"forward": long_tailed}),
    Case("matte varnish", painting={"varnish": "matte"}),
    Case("gloss varnish", painting={"varnish": "gloss"}),
    Case("no varnish", painting={"varnish": None}),
    Case("patches of all three", painting={"varnish": "patches"}),
    Case("two coats of satin", painting={"layers": 2}),
    Case("cracks", painting={"craquelure": True}),
    Case("three times the relief", painting={"relief": 3.0}),
    Case("the same with cast shadows", {"relief": 3.0}, {"shadows": True}),
    Case("lamps at 0.5 m, fall-off known", near=True),
    Case("lamps at 0.5 m taken for distant", near=True, afterwards=taken_for_distant),
    Case("8-bit linear", capture={"bits": 8}),
    Case("8-bit sRGB", capture=CODED),
    Case("8-bit sRGB read as gamma 2.2", capture=CODED, afterwards=decoded_as("2.2")),
    Case("8-bit sRGB read as gamma 1.8", capture=CODED, afterwards=decoded_as("1.8")),
    Case("patches, cracks, twice the relief, shadows, near lamps, 8-bit sRGB",
         {"varnish": "patches", "craquelure": True, "relief": 2.0},
         {"shadows": True} | CODED, near=True),
]  # fmt: skip


@lru_cache(maxsize=4)
def _painted(seed: int, size: int, options: tuple[tuple[str, Any], ...]) -> Painting:
    return simulate.painting(seed, (size, size), **dict(options))


def photographed(case: Case, system: str, seed: int, size: int) -> Capture:
    painting = _painted(seed, size, tuple(case.painting.items()))
    rig = simulate.rig(
        system, pitch_mm=painting.pitch_mm, distance_mm=DISTANCE_MM if case.near else None
    )
    return simulate.capture(painting, rig, system, **case.capture)


def degrees_between(normal: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angles ``(y, x)``; the arc tangent keeps the digits of small ones."""
    normal, truth = normal.astype(np.float64), truth.astype(np.float64)
    sine = np.linalg.norm(np.cross(normal, truth, axis=0), axis=0)
    return np.degrees(np.arctan2(sine, (normal * truth).sum(axis=0)))


def colours(reflectance: impasto.Reflectance, painting: Painting) -> dict[str, float]:
    """Spectral RMSE over 400 to 700 nm and CIEDE2000 under two lights, pixels with an estimate."""
    known = reflectance.status < impasto.Status.DARK
    coefficients = reflectance.coefficients[:, known].astype(np.float64)
    grid = reflectance.wavelengths
    shared = np.isin(painting.wavelengths, grid)
    truth = painting.basis[:, shared].T @ painting.coefficients[:, known].astype(np.float64)
    assert np.array_equal(painting.wavelengths[shared], grid)
    squared = np.square(reflectance.basis.T @ coefficients - truth).mean()
    found = {"spectral RMSE": float(np.sqrt(squared))}
    for light in ("D65", "A"):
        operator = colour.xyz_from_spectrum(grid, light) @ reflectance.basis.T
        white = colour.white_point(light)
        difference = colour.delta_e(
            colour.lab_from_xyz(operator @ coefficients, white),
            colour.lab_from_xyz(painting.xyz(light)[:, known], white),
        )
        found[f"dE00 {light}"] = float(difference.mean())
        found[f"dE00 {light} p95"] = float(np.percentile(difference, 95))
    return found


def measured(case: Case, system: str, seed: int, size: int) -> dict[str, Any]:
    """One fit against its truth. Errors of beta and gamma are relative, in percent, with sign."""
    capture = photographed(case, system, seed, size)
    stack, truth = case.afterwards(capture), capture.truth
    sbrdf = impasto.fit_sbrdf(stack, pooling="painting")
    known = sbrdf.status < impasto.Status.DARK
    angle = degrees_between(sbrdf.normal, truth.normal)[known]
    stereo = degrees_between(sbrdf.normals.normal, truth.normal)
    error = (sbrdf.diffuse - truth.diffuse)[:, known]
    row = {
        "normal deg": float(angle.mean()),
        "normal p95": float(np.percentile(angle, 95)),
        "stereo deg": float(np.nanmean(stereo)),
        "bands RMSE": float(np.sqrt(np.square(error.astype(np.float64)).mean())),
    }
    spectra = impasto.fit_reflectance(stack, sbrdf, truth.camera, training=case.training)
    row |= colours(spectra, truth.painting)
    # Several coats or kinds of varnish have no one (beta, gamma) to compare with.
    pairs = [(float(p.min()), float(p.max())) for p in (truth.beta, truth.gamma)]
    single = pairs[0][0] > 0 and all(low == high for low, high in pairs)
    for name, value, (low, _) in zip(
        ("beta", "gamma"), (sbrdf.beta, sbrdf.gamma), pairs, strict=True
    ):
        row[f"{name} %"] = 100.0 * (value / low - 1.0) if single else None
    return row | {
        "verdict": sbrdf.verdict,
        "not estimated %": 100.0 * float(1.0 - known.mean()),
    }


def averaged(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Over seeds: the mean; of beta and gamma the worst; the words if they agree."""
    result: dict[str, Any] = {}
    for key in rows[0]:
        values = [row[key] for row in rows]
        if isinstance(values[0], float):
            result[key] = (
                max(values, key=abs) if key in ("beta %", "gamma %") else float(np.mean(values))
            )
        else:
            result[key] = (
                values[0] if len(set(values)) == 1 else "; ".join(sorted(map(str, values)))
            )
    return result


def table(system: str, cases: list[Case], seeds: range, size: int) -> list[dict[str, Any]]:
    rows = []
    for case in cases:
        each = [measured(case, system, seed, size) for seed in seeds]
        rows.append({"case": case.name} | averaged(each))
        print(".", end="", flush=True)
    print()
    return rows


METHODS = (
    "least-squares", "threshold", "rank", "trimmed", "l1", "huber", "cauchy", "tukey", "robust",
)  # fmt: skip
HARD = Case("gloss, three times the relief", {"varnish": "gloss", "relief": 3.0}, {"shadows": True})


def methods(seeds: range, size: int) -> list[dict[str, Any]]:
    """Mean normal error of the photometric stereo alone, degrees."""
    rows: list[dict[str, Any]] = [{"method": method} for method in METHODS]
    for system, words in SYSTEMS.items():
        for case in (CASES[0], HARD):
            captures = [photographed(case, system, seed, size) for seed in seeds]
            for row in rows:
                angles = [
                    degrees_between(
                        impasto.fit_normals(one.stack, method=row["method"]).normal,
                        one.truth.normal,
                    )
                    for one in captures
                ]
                row[f"{words}: {case.name.split(',')[0]}"] = float(np.nanmean(angles))
    return rows


def ceilings(seeds: range, size: int) -> list[dict[str, Any]]:
    """Colours from the true responses of the bands, without noise: the estimator's own share."""
    rows = []
    for system, words in SYSTEMS.items():
        each = []
        for seed in seeds:
            painting = _painted(seed, size, ())
            camera = simulate.camera(system)
            responses = painting.reflectance_in(camera)
            each.append(colours(impasto.fit_reflectance(None, responses, camera), painting))
        rows.append({"camera": words.split(", ")[1]} | averaged(each))
    return rows


def adaptation() -> list[dict[str, Any]]:
    """Incomplete adaptation from 2862 K to 6504 K with d = 0.56 (eq. 7), against colour-science."""
    import colour as science

    kelvin = colour.adapted_temperature(2862.0, 6504.0, 0.56)
    rows = []
    for mode in ("planck", "anchored"):
        seen = colour.adaptation(2862.0, 6504.0, 0.56, mode)
        expected = science.adaptation.matrix_chromatic_adaptation_VonKries(
            seen.test_white, seen.adapted_white, transform="Von Kries"
        )
        rows.append(
            {
                "mode": mode,
                "T_D in K": f"{kelvin:.1f}",
                "mired": f"{1e6 / kelvin:.2f}",
                "largest difference of the matrix": f"{np.abs(seen.matrix - expected).max():.0e}",
            }
        )
    return rows


def with_pigments(data: Path) -> list[Case]:
    """A painting in measured Kremer pigments (Deborah et al. 2022), if they are at hand."""
    path = data / "spectra" / "hyppigments.npz"
    if not path.exists():
        return []
    file = np.load(path)
    spectra, grid = file["reflectance"].astype(float), file["wavelength"].astype(float)
    # The tuple is hashable and equal to itself: all that the cache of paintings asks.
    # Its pigments must not be learnt from.
    return [
        Case(
            "painted in Kremer pigments",
            painting={"pigments": _Pair((spectra, grid))},
            training=general_training(),
        )
    ]


class _Pair(tuple[np.ndarray, np.ndarray]):
    """Compared by identity: arrays have no truth of their own."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--size", type=int, default=512, help="pixels of a side")
    parser.add_argument("--seeds", type=int, default=3, help="paintings per row")
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--methods", action="store_true", help="only those of the stereo")
    parser.add_argument("--write", action="store_true", help="record the results")
    options = parser.parse_args()
    seeds = range(options.seeds)
    command = f"python benches/python/accuracy.py --size {options.size} --seeds {options.seeds}"
    if options.methods:
        made = methods(seeds, options.size)
        show("methods", made)
        if options.write:
            recorded = json.loads((RESULTS / "accuracy.json").read_text(encoding="utf-8"))
            run = run_info(f"{command} --methods --write")
            write("accuracy.json", recorded | {"run of methods": run, "methods": made})
            set_tables(ROOT / "docs" / "accuracy.md")
        return
    cases = CASES + with_pigments(options.data)
    tables: dict[str, Any] = {}
    for system in SYSTEMS:
        tables[system] = table(system, cases, seeds, options.size)
        show(f"{system}: {SYSTEMS[system]}", tables[system])
    for name, made in (
        ("methods", methods(seeds, options.size)),
        ("ceilings", ceilings(seeds, options.size)),
        ("adaptation", adaptation()),
    ):
        tables[name] = made
        show(name, made)
    if options.write:
        run = run_info(f"{command} --write")
        setting = {"size": options.size, "seeds": list(seeds)}
        write("accuracy.json", {"run": run} | setting | tables)
        set_tables(ROOT / "docs" / "accuracy.md")


if __name__ == "__main__":
    main()
