"""Exports opened by the programs that they are for; writes ``exports.json`` beside this file.

    python tests/oracles/exports.py [mitsuba blender blender_normals usd materialx gltf_validator]

With names only these programs are asked, and the others' numbers stay. ``blender_normals`` also
writes ``exports_blender.png``: a normal map in Blender under four lamps, above what impasto shows.
Needs mitsuba, usd-core and materialx from PyPI, Debian's blender and python3-numpy, node, and
gltf-validator from npm in ``node_modules`` of the current folder. ``tests/test_exports.py`` reads
the numbers; it needs none of these.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

FILE = Path(__file__).with_suffix(".json")
ROWS, COLUMNS = 24, 32
VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
  .then(report => console.log(JSON.stringify({version: validator.version(), ...report.issues})));
"""


def maps() -> dict[str, np.ndarray]:
    """A small panel: normals up to 20 degrees from the front, colours, one width of gloss."""
    rng = np.random.default_rng(22)
    slope = 0.35 * rng.uniform(-1.0, 1.0, (2, ROWS, COLUMNS))
    normal = np.stack([slope[0], slope[1], np.ones((ROWS, COLUMNS))])
    normal /= np.linalg.norm(normal, axis=0)
    return {
        "normal": normal,
        "diffuse": rng.uniform(0.05, 0.8, (3, ROWS, COLUMNS)),
        "beta": rng.uniform(1.0, 8.0, (ROWS, COLUMNS)),
        "specular": rng.uniform(0.1, 0.6, (2, 3, ROWS, COLUMNS)),
        "cxy": np.stack([np.full((ROWS, COLUMNS), -0.98), np.full((ROWS, COLUMNS), -1.0)]),
        "cz": np.stack([np.full((ROWS, COLUMNS), 1.0), np.full((ROWS, COLUMNS), 0.97)]),
        "exponent": np.stack([np.full((ROWS, COLUMNS), 60.0), np.full((ROWS, COLUMNS), 8.0)]),
    }


def varnished() -> Any:
    """Paint under a smooth interface, as ``roughplastic`` is."""
    import impasto

    found = maps()
    return impasto.Surface.torrance_sparrow(
        found["normal"], found["diffuse"], found["beta"], 0.12, coated=True, pitch_mm=0.5
    )


def lobed() -> Any:
    """Two Lafortune lobes."""
    import impasto

    found = maps()
    names = ("normal", "diffuse", "specular", "cxy", "cz", "exponent")
    return impasto.Surface.lafortune(*(found[name] for name in names), pitch_mm=0.5)


def of_mitsuba(folder: Path) -> dict[str, Any]:
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    from impasto import DistantLight, Scene, export, render
    from impasto.export.loss import sampled, seen
    from impasto.export.mitsuba import shown_by

    report = export.to("mitsuba", varnished(), folder / "plastic")
    picture = _rendered(mitsuba, folder / "plastic" / "scene.xml")
    light = (0.0, 0.5**0.5, 0.5**0.5)
    scene = Scene([DistantLight(light)], exposure=1.0)
    ours = render(varnished(), scene).linear
    at = sampled(np.ones((ROWS, COLUMNS), bool))
    text = (folder / "plastic" / "scene.xml").read_text()
    width = float(text.split('name="alpha" value="')[1].split('"')[0])
    modelled = shown_by(folder / "plastic", width, 1.45)(light, None, at)
    difference = np.abs(picture.reshape(3, -1)[:, at] - modelled) / modelled.max()

    export.to("mitsuba", lobed(), folder / "lobes")
    sys.path.insert(0, str(folder / "lobes"))
    __import__("lafortune")
    theirs = _rendered(mitsuba, folder / "lobes" / "scene_lafortune.xml")
    own = render(lobed(), scene).linear
    from impasto.colour import delta_e

    colours = delta_e(seen(picture.reshape(3, -1)), seen(ours.reshape(3, -1)))
    lobes = np.abs(theirs - own) / own.max()
    return {
        "version": mitsuba.__version__,
        "plastic_dE_p50": float(np.percentile(colours, 50)),
        "plastic_dE_p95": float(np.percentile(colours, 95)),
        "plastic_reported_p95": report.p95,
        "plastic_model_difference_most": float(difference.max()),
        "lafortune_difference_most": float(lobes.max()),
    }


def _rendered(mitsuba: Any, path: Path) -> np.ndarray:
    """The middle of each pixel is what its maps say: many samples, one lamp, no noise."""
    picture = np.array(mitsuba.render(mitsuba.load_file(str(path)), spp=64))
    return np.moveaxis(picture[..., :3], -1, 0)


def of_blender(folder: Path) -> dict[str, Any]:
    from impasto import DistantLight, Scene, export, render
    from impasto.colour import delta_e
    from impasto.export.gltf import shown_by
    from impasto.export.loss import seen
    from impasto.io import read_image

    glb, picture = folder / "blender.glb", folder / "blender.exr"
    report = export.to("gltf", varnished(), glb)
    command = ["blender", "-b", "--factory-startup", "--python"]
    command += [str(FILE.with_name("exports_blender.py")), "--", str(glb), str(picture)]
    # Its own numpy, not that of this interpreter.
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [*command, str(COLUMNS), str(ROWS)], capture_output=True, text=True, check=True, env=own
    )
    version, size = done.stdout.split("IMPASTO ")[1].split()[:2]
    theirs = seen(read_image(picture)[:3].reshape(3, -1))
    light = (0.0, 0.5**0.5, 0.5**0.5)
    ours = render(varnished(), Scene([DistantLight(light)], exposure=1.0)).linear
    modelled = shown_by(glb.read_bytes(), glb)(light, None, np.arange(ROWS * COLUMNS))
    from_model = np.percentile(delta_e(theirs, seen(modelled)), (50, 95))
    from_render = np.percentile(delta_e(theirs, seen(ours.reshape(3, -1))), (50, 95))
    return {
        "version": version,
        "size_m": [float(one) for one in size.split(",")],
        "model_dE_p50": float(from_model[0]),
        "model_dE_p95": float(from_model[1]),
        "render_dE_p50": float(from_render[0]),
        "render_dE_p95": float(from_render[1]),
        "reported_p95": report.p95,
    }


def dome() -> Any:
    """A matte panel with a dome on it: its left side leans left, its upper side up."""
    import impasto

    y, x = np.mgrid[:48, :64]
    right, up = (x - 31.5) / 16.0, (23.5 - y) / 16.0
    height = np.exp(-(right**2) - up**2)
    slope = 1.2 * height
    normal = np.stack([slope * right, slope * up, np.ones_like(height)])
    normal /= np.linalg.norm(normal, axis=0)
    return impasto.Surface(normal, np.ones((3, 48, 64)), pitch_mm=0.5)


def of_blender_normals(folder: Path) -> dict[str, Any]:
    from impasto import DistantLight, Scene, export, render
    from impasto.io import read_image, write_png8

    painting = dome()
    rows, columns = painting.shape
    export.to("normal-map", painting, folder / "normal.png")
    command = ["blender", "-b", "--factory-startup", "--python"]
    command += [str(FILE.with_name("exports_blender_normals.py")), "--"]
    command += [str(folder / "normal.png"), str(folder), str(columns), str(rows)]
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=own)
    found: dict[str, Any] = {"version": done.stdout.split("IMPASTO ")[1].split()[0]}
    across, rise = 0.75**0.5, 0.5
    sides = {"left": (-1, 0), "right": (1, 0), "above": (0, 1), "below": (0, -1)}
    panels = []
    for name, (x, y) in sides.items():
        theirs = read_image(folder / f"{name}.exr")[:3]
        light = DistantLight((across * x, across * y, rise))
        ours = render(painting, Scene([light], exposure=1.0)).linear
        towards, away = {
            "left": (theirs[:, :, :32], theirs[:, :, 32:]),
            "right": (theirs[:, :, 32:], theirs[:, :, :32]),
            "above": (theirs[:, :24], theirs[:, 24:]),
            "below": (theirs[:, 24:], theirs[:, :24]),
        }[name]
        found[name] = {
            "towards_the_lamp": float(towards.mean()),
            "away_from_it": float(away.mean()),
            "difference_p50": float(np.median(np.abs(theirs - ours))),
            "difference_p99": float(np.percentile(np.abs(theirs - ours), 99)),
        }
        panels.append(np.concatenate([theirs, ours], axis=1))
    picture = np.clip(np.concatenate(panels, axis=2), 0.0, 1.0) ** (1 / 2.2)
    large = np.rint(255.0 * picture.repeat(4, axis=1).repeat(4, axis=2)).astype(np.uint8)
    write_png8(FILE.with_name("exports_blender.png"), large)
    return found


def of_usd(folder: Path) -> dict[str, Any]:
    from pxr import Usd, UsdGeom, UsdShade, UsdValidation

    from impasto import export

    report = export.to("usd", varnished(), folder / "usd", name="panel 1", displaced=True)
    path = folder / "usd" / "painting.usda"
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"{stage.GetDefaultPrim().GetPath()}/Panel"))
    material = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0]
    shader = material.ComputeSurfaceSource()[0]
    every = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    findings = UsdValidation.ValidationContext(every).Validate(stage)
    low, high = np.array(mesh.GetExtentAttr().Get())
    points = np.array(mesh.GetPointsAttr().Get())
    return {
        "version": ".".join(map(str, Usd.GetVersion())),
        "validators": len(every),
        "findings": [one.GetErrorAsString() for one in findings],
        "metres_per_unit": UsdGeom.GetStageMetersPerUnit(stage),
        "up": str(UsdGeom.GetStageUpAxis(stage)),
        "size": (high - low).tolist(),
        "points": len(points),
        "shader": str(shader.GetIdAttr().Get()),
        "textures": sum(
            UsdShade.Shader(prim).GetIdAttr().Get() == "UsdUVTexture"
            for prim in stage.Traverse()
            if prim.IsA(UsdShade.Shader)
        ),
        "loss": stage.GetRootLayer().customLayerData["loss"] == report.summary,
    }


def of_materialx(folder: Path) -> dict[str, Any]:
    import MaterialX
    from MaterialX import PyMaterialXGenGlsl, PyMaterialXGenShader

    from impasto import export

    export.to("materialx", varnished(), folder / "materialx")
    document = MaterialX.createDocument()
    library = MaterialX.createDocument()
    path = MaterialX.getDefaultDataSearchPath()
    MaterialX.loadLibraries(MaterialX.getDefaultDataLibraryFolders(), path, library)
    MaterialX.readFromXmlFile(document, str(folder / "materialx" / "painting.mtlx"))
    document.setDataLibrary(library)
    valid, message = document.validate()
    lines = {}
    for node in document.getMaterialNodes():
        generator = PyMaterialXGenGlsl.GlslShaderGenerator.create()
        context = PyMaterialXGenShader.GenContext(generator)
        context.registerSourceCodeSearchPath(path)
        management = PyMaterialXGenShader.DefaultColorManagementSystem.create(generator.getTarget())
        management.loadLibrary(library)
        generator.setColorManagementSystem(management)
        shader = generator.generate(node.getName(), node, context)
        source = shader.getSourceCode(PyMaterialXGenShader.PIXEL_STAGE)
        lines[node.getName()] = source.count("\n")
    undeclared = [
        f"{node.getName()}.{one.getName()}"
        for node in document.getNodes()
        for one in node.getInputs()
        if (about := node.getNodeDef()) is None or about.getActiveInput(one.getName()) is None
    ]
    return {
        "version": MaterialX.getVersionString(),
        "valid": bool(valid),
        "message": message,
        "surfaces": [
            one.getCategory() for one in document.getNodes() if "surface" in one.getType()
        ],
        "missing": [
            one.getValueString()
            for node in document.getNodes("image")
            for one in node.getInputs()
            if one.getName() == "file"
            and not (folder / "materialx" / one.getValueString()).is_file()
        ],
        "undeclared": undeclared,
        "shader_lines": lines,
    }


def of_validator(folder: Path) -> dict[str, Any]:
    from impasto import export

    found = {}
    for name, options in (("panel", {}), ("relief", {"displaced": True})):
        path = folder / f"{name}.glb"
        export.to("gltf", varnished(), path, **options)
        done = subprocess.run(
            ["node", "-e", VALIDATE, str(path)], capture_output=True, text=True, check=True
        )
        found[name] = json.loads(done.stdout)
    return found


PROGRAMS = {
    "mitsuba": of_mitsuba,
    "blender": of_blender,
    "blender_normals": of_blender_normals,
    "usd": of_usd,
    "materialx": of_materialx,
    "gltf_validator": of_validator,
}


def main() -> None:
    wanted = sys.argv[1:] or list(PROGRAMS)
    found = json.loads(FILE.read_text(encoding="utf-8")) if FILE.is_file() else {}
    found["command"] = "python tests/oracles/exports.py"
    with tempfile.TemporaryDirectory() as name:
        for program in wanted:
            found[program] = PROGRAMS[program](Path(name))
    FILE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    sys.stdout.write(FILE.read_text())


if __name__ == "__main__":
    main()
