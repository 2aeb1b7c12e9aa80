"""Photographs of known surfaces under many lights, path-traced by Mitsuba 3.

    pip install mitsuba
    python benches/python/path_traced_scenes.py [--cache DIR] [--only TEXT] [--pictures]

Objects are seen by an orthographic camera under distant lights. Painted panels are photographed by
four rigs: distant; with a camera at 2.78 halves of the side; with lamps at 3 halves; with both.
Interreflection and cast shadows are in the photographs; so are the renderer's own noise and its own
models of gloss (Trowbridge-Reitz, "GGX"; under "plastic", the diffuse part lies below an interface
that light crosses twice), which are not those of the fit. Each scene becomes one ``.npz`` in the
cache (default: target/path_traced). Each photograph has its own seed.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from path_traced_shapes import SHAPES, Mesh, panel
from record import ROOT

import impasto
from impasto.io.images.write import write_png8

Array = NDArray[np.float64]
CACHE = ROOT / "target" / "path_traced"
SIZE, LIGHTS, HELD = 96, 49, 12
SAMPLES, INDIRECT = 36, 16
"""Samples per pixel, square numbers: of light from the lamp, and of light from other surfaces."""
DEPTH, FLAT_DEPTH = 5, 3
"""Most steps of a path from the camera to the lamp, for objects and for panels."""
CAMERA, LAMPS = 2.78, 3.0
"""Distances of near cameras and lamps, in halves of the side."""
HALF_MM = 50.0
REACH, LIKE = 2, 0.05
"""Neighbours, in pixels and in 1 minus the cosine between normals, that share indirect light."""
PAINTED = "painted"
"""As a colour: the texture of the shape."""

Material = dict[str, Any]


def _plastic(alpha: float, colour: Any) -> Material:
    return {"type": "roughplastic", "diffuse_reflectance": colour, "alpha": alpha}


MATERIALS: dict[str, Any] = {
    "diffuse": lambda colour: {"type": "diffuse", "reflectance": colour},
    "plastic.05": lambda colour: _plastic(0.05, colour),
    "plastic.1": lambda colour: _plastic(0.1, colour),
    "plastic.3": lambda colour: _plastic(0.3, colour),
    "principled": lambda colour: {
        "type": "principled",
        "base_color": colour,
        "roughness": 0.45,
        "specular": 0.5,
    },
    "gold": lambda colour: {"type": "roughconductor", "material": "Au", "alpha": 0.25},
}
"""Each takes a colour; gold has its own."""

PLAIN = (0.55, 0.38, 0.26)


@dataclass(frozen=True)
class Scene:
    """One stack: a shape, its material, and the rig that photographs it.

    ``slope`` is the root mean square of a panel's slopes in degrees, 0 for objects. ``camera`` and
    ``lamps`` are distances in halves of the side, None: infinite.
    """

    name: str
    shape: str
    material: str
    painted: bool = False
    slope: float = 0.0
    camera: float | None = None
    lamps: float | None = None


def _objects() -> Iterator[Scene]:
    for name in (
        "sphere diffuse", "bust plastic.1", "relief painted-diffuse", "vase gold",
        "bumpy plastic.05", "sphere plastic.1", "relief plastic.3", "bust diffuse",
        "vase painted-plastic.05", "bumpy gold", "bust principled", "relief painted-plastic.1",
        "bumpy plastic.3", "vase principled", "bust plastic.3", "bumpy diffuse",
        "relief gold", "relief diffuse",
    ):  # fmt: skip
        shape, material = name.split()
        painted = material.startswith(PAINTED)
        yield Scene(name.replace(" ", "-"), shape, material.split("-")[-1], painted)


RIGS: dict[str, dict[str, float]] = {
    "far": {},
    "camera": {"camera": CAMERA},
    "lamps": {"lamps": LAMPS},
    "near": {"camera": CAMERA, "lamps": LAMPS},
}


def _panels() -> Iterator[Scene]:
    cases = [(2.0, one) for one in ("plastic.1", "diffuse", "gold", "plastic.3")]
    cases += [(0.7, "plastic.05"), (3.0, "plastic.1")]
    for slope, material in cases:
        for rig, distances in RIGS.items():
            if rig == "near" and slope != 2.0:
                continue
            name = f"panel{slope:g}-{material}-{rig}"
            yield Scene(name, "panel", material, True, slope, **distances)


SCENES = {scene.name: scene for scene in (*_objects(), *_panels())}


def spiral(count: int, high: float, low: float, start: float = 0.0) -> Array:
    """``(count, 3)`` directions in equal steps of z."""
    z = np.linspace(high, low, count)
    turn = start + np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def lights() -> tuple[Array, Array]:
    """Directions of the lights that are fitted and of those held out: 75 to 13 degrees high."""
    return spiral(LIGHTS, 0.966, 0.225), spiral(HELD, 0.94, 0.3, start=1.0)


class Studio:
    """A scene in the renderer: photographs of it, and its normals."""

    def __init__(self, scene: Scene) -> None:
        import mitsuba

        mitsuba.set_variant("scalar_rgb")
        self.mitsuba: Any = mitsuba
        self.scene = scene
        meshes, colours = self._shape()
        colour: Any = {"type": "rgb", "value": list(PLAIN)}
        if scene.painted:
            colour = {
                "type": "bitmap",
                "bitmap": mitsuba.Bitmap(colours.astype(np.float32)),
                "raw": True,
                "filter_type": "bilinear",
            }
        bsdf = {"type": "twosided", "one": MATERIALS[scene.material](colour)}
        self.parts: dict[str, Any] = {}
        with tempfile.TemporaryDirectory() as folder:
            for index, mesh in enumerate(meshes):
                path = mesh.write(Path(folder) / f"{index}.ply")
                loaded = mitsuba.load_dict({"type": "ply", "filename": str(path), "bsdf": bsdf})
                self.parts[f"part{index}"] = loaded
        if not meshes:
            self.parts["part"] = {"type": "sphere", "radius": 0.92, "bsdf": bsdf}
        self.sensor = mitsuba.load_dict(self._camera())
        self.lit = self._lit()
        self.paths = self._path(2), self._path(FLAT_DEPTH if scene.slope else DEPTH)
        self.normal, self.mask = self._normals()
        self.colour = self._colours() if scene.painted else np.ones((3, 1, 1))

    def _shape(self) -> tuple[list[Mesh], Array]:
        if self.scene.slope:
            mesh, colours = panel(self.scene.slope, SIZE)
            return [mesh], colours
        colours = panel(1.0, SIZE)[1]
        return ([] if self.scene.shape == "sphere" else SHAPES[self.scene.shape]()), colours

    def _camera(self) -> dict[str, Any]:
        near = self.scene.camera
        look = self.mitsuba.ScalarTransform4f().look_at(
            origin=[0.0, 0.0, near or 8.0], target=[0.0, 0.0, 0.0], up=[0.0, 1.0, 0.0]
        )
        film = {
            "type": "hdrfilm",
            "width": SIZE,
            "height": SIZE,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        }
        camera = {"to_world": look, "film": film, "sampler": {"type": "multijitter"}}
        if near is None:
            return {"type": "orthographic", **camera}
        angle = float(np.degrees(2.0 * np.arctan(1.0 / near)))
        return {"type": "perspective", "fov": angle, **camera}

    def _lit(self) -> Any:
        """The scene with a light under which a white board in the middle reads 1."""
        light = {"type": "rgb", "value": float(np.pi * (self.scene.lamps or 1.0) ** 2)}
        emitter = {"type": "directional", "irradiance": light}
        if self.scene.lamps is not None:
            emitter = {"type": "point", "intensity": light}
        parts = {"emitter": emitter, "sensor": self.sensor, **self.parts}
        return self.mitsuba.load_dict({"type": "scene", **parts})

    def _path(self, depth: int) -> Any:
        return self.mitsuba.load_dict({"type": "path", "max_depth": depth, "rr_depth": 100})

    def photograph(self, direction: Array, seed: int) -> NDArray[np.float32]:
        """``(band, y, x)`` radiance relative to a white board that faces the light."""
        values = self.mitsuba.traverse(self.lit)
        if self.scene.lamps is None:
            up = [0.0, 1.0, 0.0] if abs(direction[1]) < 0.9 else [1.0, 0.0, 0.0]
            shines = self.mitsuba.ScalarTransform4f().look_at(
                origin=[0.0, 0.0, 0.0], target=list(-direction), up=up
            )
            values["emitter.to_world"] = shines
        else:
            values["emitter.position"] = list(self.scene.lamps * direction)
        values.update()
        direct, path = self.paths
        light = self._render(direct, SAMPLES, seed)
        others = self._render(path, INDIRECT, seed) - self._render(direct, INDIRECT, seed)
        return (light + self.colour * self._smooth(others / self.colour)).astype(np.float32)

    def _render(self, integrator: Any, samples: int, seed: int) -> Array:
        image = self.mitsuba.render(self.lit, integrator=integrator, spp=samples, seed=seed)
        return np.moveaxis(np.array(image, dtype=np.float64), -1, 0)

    def _smooth(self, light: Array) -> Array:
        """Light that was reflected between surfaces, averaged over neighbours of like normal.

        It varies slowly, and has nearly all of the noise.
        """
        total, weights = np.zeros_like(light), np.full(light.shape[1:], 1e-30)
        for down in range(-REACH, REACH + 1):
            for right in range(-REACH, REACH + 1):
                there = np.roll(self.normal, (down, right), (1, 2))
                apart = np.maximum(1.0 - (there * self.normal).sum(axis=0), 0.0)
                weight = np.exp(-apart / LIKE - (down**2 + right**2) / REACH**2)
                total += weight * np.roll(light, (down, right), (1, 2))
                weights += weight
        return np.asarray(total / weights)

    def _colours(self) -> Array:
        """Diffuse reflectance ``(band, y, x)``."""
        aov = self.mitsuba.load_dict({"type": "aov", "aovs": "colour:albedo"})
        return np.maximum(self._render(aov, SAMPLES, 0), 0.01)

    def _normals(self) -> tuple[Array, NDArray[np.bool_]]:
        """Mean unit normals ``(3, y, x)`` of pixels, and where pixels lie within the surface."""
        aov = self.mitsuba.load_dict({"type": "aov", "aovs": "normal:sh_normal"})
        normal = self._render(aov, 4 * SAMPLES, 0)
        length = np.linalg.norm(normal, axis=0)
        # Pixels on an outline, and where the surface folds within a pixel, have no one normal.
        inside = length > 0.9
        for axis in (0, 1):
            inside = inside & np.roll(inside, 1, axis) & np.roll(inside, -1, axis)
        inside[[0, 1, -2, -1], :] = inside[:, [0, 1, -2, -1]] = False
        return normal / np.where(length > 0.0, length, 1.0), inside


@dataclass(frozen=True, eq=False)
class Traced:
    """A stack with its truth. Samples ``(obs, band, y, x)`` are relative to a white board."""

    scene: Scene
    samples: NDArray[np.float32]
    lights: Array
    held: NDArray[np.float32]
    held_lights: Array
    normal: NDArray[np.float32]
    mask: NDArray[np.bool_]

    def save(self, path: Path) -> None:
        facts = asdict(self.scene) | {"half_mm": HALF_MM, "pitch_mm": 2.0 * HALF_MM / SIZE}
        arrays = {name: value for name, value in vars(self).items() if name != "scene"}
        np.savez_compressed(path, facts=np.array(json.dumps(facts)), **arrays)

    @classmethod
    def load(cls, path: Path) -> Traced:
        with np.load(path) as file:
            facts = json.loads(str(file["facts"]))
            arrays = {name: file[name] for name in file.files if name != "facts"}
        known = {name: value for name, value in facts.items() if not name.endswith("_mm")}
        return cls(Scene(**known), **arrays)

    def rig(
        self, lights: Array, *, near_camera: bool, near_lamps: bool, strength: float = 1.0
    ) -> impasto.Rig:
        """The rig of lights in these directions; what is near is told, or taken for distant."""
        lamps: list[impasto.DistantLight | impasto.PointLight] = []
        for x, y, z in lights.tolist():
            if near_lamps and self.scene.lamps is not None:
                far = self.scene.lamps * HALF_MM
                lamps.append(impasto.PointLight((far * x, far * y, far * z), strength))
            else:
                lamps.append(impasto.DistantLight((x, y, z), strength))
        view = None
        if near_camera and self.scene.camera is not None:
            view = impasto.PointView((0.0, 0.0, self.scene.camera * HALF_MM))
        return impasto.Rig(lamps, views=view, pitch_mm=2.0 * HALF_MM / SIZE)


def traced(scene: Scene, cache: Path = CACHE) -> Traced:
    """A scene's photographs, rendered if they are not in the cache."""
    path = cache / f"{scene.name}.npz"
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        studio = Studio(scene)
        given, held = lights()
        shots = [studio.photograph(light, seed) for seed, light in enumerate((*given, *held))]
        shown, truth = np.stack(shots), studio.normal.astype(np.float32)
        made = Traced(scene, shown[:LIGHTS], given, shown[LIGHTS:], held, truth, studio.mask)
        part = path.with_name(f"part-{path.name}")
        made.save(part)
        part.rename(path)
    return Traced.load(path)


def sheet(one: Traced) -> NDArray[np.uint8]:
    """Three photographs and the normals side by side."""
    curve = impasto.Encoding("srgb", white=255.0)
    shots = [curve.encode(one.samples[index]) for index in (4, 24, 44)]
    coded = np.concatenate([*shots, 127.5 * (one.normal + 1.0) * one.mask], axis=2)
    large = coded.repeat(2, axis=1).repeat(2, axis=2)
    return np.ascontiguousarray(np.rint(np.moveaxis(large, 0, -1)).astype(np.uint8))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cache", type=Path, default=CACHE)
    parser.add_argument("--only", default="", help="scenes whose name contains this")
    parser.add_argument("--pictures", action="store_true", help="write a picture of each scene")
    options = parser.parse_args()
    for scene in SCENES.values():
        if options.only not in scene.name:
            continue
        start = time.perf_counter()
        new = not (options.cache / f"{scene.name}.npz").exists()
        one = traced(scene, options.cache)
        if new:
            print(f"{scene.name}: {time.perf_counter() - start:.0f} s", flush=True)
        if options.pictures:
            write_png8(options.cache / f"{scene.name}.png", sheet(one))


if __name__ == "__main__":
    main()
