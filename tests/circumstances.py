"""Every call that spreads over pixels, on one small capture: what test_calls.py varies."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import impasto
from impasto import simulate

SIZE = (97, 131)
"""Three tiles and a bit; rows end in the middle of every register."""

FEW = (67, 83)
"""Pixels for slow instruction sets and new processes: two tiles, and rows that end in the middle of
registers."""

SCENE = impasto.Scene(
    [impasto.DistantLight((0.7, 0.4, 0.3)), impasto.PointLight((30.0, 10.0, 40.0), 0.4)],
    view=(0.3, -0.2, 1.0),
    shadows=True,
)

LEARNED = impasto.LearnedNormals(scale=0.014, correlation=0.125)
"""Two numbers of a painting for its normals, in which its parts and bad pixels have no say."""

Arrays = tuple[Any, ...]


def capture(size: tuple[int, int] = SIZE) -> Any:
    """A satin-varnished landscape under sixteen lights, six bands, 12 bits, with noise."""
    return simulate.default_capture(seed=4, size=size)


def _predict(capture: Any, **options: Any) -> Arrays:
    truth = capture.truth
    surface = impasto.Surface.torrance_sparrow(truth.normal, truth.diffuse, truth.beta, truth.gamma)
    return (surface.predict(truth.rig, **options),)


def _render(capture: Any, **options: Any) -> Arrays:
    truth = capture.truth
    surface = impasto.Surface.torrance_sparrow(
        truth.normal,
        truth.diffuse[[4, 2, 0]],
        truth.beta[0],
        truth.gamma[0],
        pitch_mm=truth.painting.pitch_mm,
    )
    image = impasto.render(surface, SCENE, height=truth.painting.height, **options)
    return image.xyz, image.display, image.coverage


def _reflectance(capture: Any, **options: Any) -> Arrays:
    truth = capture.truth
    fit = impasto.fit_reflectance(capture.stack, truth.diffuse, truth.camera, **options)
    return fit.coefficients, fit.status


def _normals(capture: Any, **options: Any) -> Arrays:
    return arrays(impasto.fit_normals(capture.stack, **options))


def _sbrdf(capture: Any, **options: Any) -> Arrays:
    fit = impasto.fit_sbrdf(capture.stack, pooling="painting", **options)
    return (*arrays(fit), *arrays(fit.normals), np.array([fit.beta, fit.gamma]))


def _lobe(capture: Any, **options: Any) -> Arrays:
    samples = capture.stack.samples[:, 0].astype(np.float32)
    phi = np.linspace(0.0, 0.6, len(samples), dtype=np.float32)[:, None, None]
    return arrays(impasto.fit_highlight(np.broadcast_to(phi, samples.shape), samples, **options))


_made: list[impasto.Stack] = []


def views() -> impasto.Stack:
    """110 photographs from as many views, of patches of varnish; made when first asked for."""
    if not _made:
        painting = simulate.painting(seed=4, size=(23, 29), varnish="patches")
        rig = simulate.rig("snel-lafortune").take(range(0, 770, 7))
        _made.append(simulate.capture(painting, rig, "rgb", model="lafortune").stack)
    return _made[0]


def keep(path: Path, capture: Any) -> Path:
    """Write a capture and :func:`views` for another process, which then need not simulate them."""
    path.write_bytes(pickle.dumps((capture, views())))
    return path


def kept(path: str) -> Any:
    """The capture that :func:`keep` wrote."""
    capture, seen = pickle.loads(Path(path).read_bytes())
    _made[:] = [seen]
    return capture


def _lafortune(_: Any, **options: Any) -> Arrays:
    stack = views()
    normals = impasto.fit_normals(stack, method="huber")
    fit = impasto.fit_sbrdf(stack, model="lafortune", normals=normals, **options)
    return (*arrays(fit), fit.predict(fit.rig.take(range(5))))


def _lobes(capture: Any, **options: Any) -> Arrays:
    # Some tiles of it: the baseline's emulated multiply-add is slow.
    stack = impasto.Stack(capture.stack.samples[:, :3, :20], lights=capture.stack.rig)
    return arrays(impasto.fit_sbrdf(stack, pooling="pixel", **options))


def _table(capture: Any, **options: Any) -> Arrays:
    return _lobes(capture, effort=impasto.Effort(start="multistart"), **options)


def _double(capture: Any, **options: Any) -> Arrays:
    return _lobes(capture, effort=impasto.Effort(rounds=1, precision="double"), **options)


def _steps(capture: Any, **options: Any) -> Arrays:
    return _lobes(capture, effort=impasto.Effort(rounds=3, colour_iterations=1), **options)


def _height(capture: Any, **options: Any) -> Arrays:
    return (impasto.integrate_normals(capture.truth.normal, 0.2, **options),)


CALLS: dict[str, Callable[..., Arrays]] = {
    "predict": _predict,
    "render": _render,
    "fit_highlight": _lobe,
    "fit_normals": _normals,
    "fit_sbrdf": _sbrdf,
    "fit_sbrdf lafortune": _lafortune,
    "fit_sbrdf, pooling='pixel'": _lobes,
    "fit_sbrdf, pooling='pixel', a table": _table,
    "fit_sbrdf, pooling='pixel', in double precision": _double,
    "fit_sbrdf, pooling='pixel', rounds of one step": _steps,
    "fit_reflectance": _reflectance,
    "integrate_normals": _height,
}
"""``call(capture, threads=..., progress=...)`` to the arrays that it returns."""


def arrays(result: Any) -> Arrays:
    """The maps of a result."""
    values = (getattr(result, field.name) for field in fields(result))
    return tuple(value for value in values if isinstance(value, np.ndarray))


def _long_predict(capture: Any, **options: Any) -> Arrays:
    truth = capture.truth
    normal, diffuse = (np.tile(m, (1, 5, 4)) for m in (truth.normal, truth.diffuse[:1]))
    rig = impasto.Rig(8 * truth.rig.lights)
    surface = impasto.Surface.torrance_sparrow(normal, diffuse, 8.0, 0.2)
    return (surface.predict(rig, **options),)


def _long_normals(capture: Any, **options: Any) -> Arrays:
    stack = capture.stack
    wide = impasto.Stack(np.tile(stack.samples, (1, 1, 9, 7)), lights=stack.rig)
    return arrays(impasto.fit_normals(wide, **options))


def _long_sbrdf(capture: Any, **options: Any) -> Arrays:
    stack = capture.stack
    wide = impasto.Stack(np.tile(stack.samples, (1, 1, 4, 3)), lights=stack.rig)
    normals = impasto.fit_normals(wide, method="least-squares")
    return arrays(impasto.fit_sbrdf(wide, pooling="painting", normals=normals, **options))


def _long_lafortune(_: Any, **options: Any) -> Arrays:
    stack = views()
    wide = impasto.Stack(np.tile(stack.samples, (1, 1, 4, 6)), lights=stack.rig)
    normals = impasto.fit_normals(wide, method="least-squares")
    return arrays(impasto.fit_sbrdf(wide, model="lafortune", normals=normals, **options))


def _long_lobes(capture: Any, **options: Any) -> Arrays:
    stack = capture.stack
    wide = impasto.Stack(np.tile(stack.samples[:, :3], (1, 1, 3, 2)), lights=stack.rig)
    return arrays(impasto.fit_sbrdf(wide, pooling="pixel", normals="least-squares", **options))


LONG: dict[str, Callable[..., Arrays]] = {
    "predict": _long_predict,
    "fit_normals": _long_normals,
    "fit_sbrdf": _long_sbrdf,
    "fit_sbrdf lafortune": _long_lafortune,
    "fit_sbrdf, pooling='pixel'": _long_lobes,
}
"""Calls that take a second or more on one thread with the baseline's instructions."""


def digest(arrays: Arrays) -> str:
    """Of every bit of some arrays."""
    hashed = hashlib.sha256()
    for array in arrays:
        hashed.update(np.ascontiguousarray(array).tobytes())
    return hashed.hexdigest()


def digests(capture: Any, threads: int) -> dict[str, str]:
    """One per call."""
    return {name: digest(call(capture, threads=threads)) for name, call in CALLS.items()}
