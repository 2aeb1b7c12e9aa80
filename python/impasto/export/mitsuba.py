"""A scene for Mitsuba 3 [@mitsuba3]: ``roughplastic``, or Lafortune lobes by a plug-in.

Torrance-Sparrow facets of half-width gamma are Beckmann's of ``alpha = gamma / sqrt(ln 2)`` for
small angles. ``roughplastic`` has one width for the painting and a strength per pixel.
"""

from __future__ import annotations

import math
from importlib.resources import files as resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.export.folder import export_folder
from impasto.export.loss import REPORT, LossReport, Shown, measure, written
from impasto.export.rough_interface import rough_interface
from impasto.export.shading import Angles, rough_plastic
from impasto.export.source import Direction, Map, Source
from impasto.export.textures import Textures, textures
from impasto.io.files import atomic_bytes
from impasto.io.images.read import read_image
from impasto.io.images.write import write_exr
from impasto.surface import Surface

SCENE, LOBES, PLUGIN = "scene.xml", "scene_lafortune.xml", "lafortune.py"
LOST = (
    "the width of each pixel's lobe: roughplastic has one for the painting",
    "ambient light, which stands in the diffuse colour, the same for all lights",
    "shadows, interreflections and what photographs show besides the model",
    "spectra: colours are those under D65",
)
_EYE_MM = 1000.0
_UV = '<transform name="to_uv"><scale x="1" y="-1"/></transform>'
"""A rectangle counts v from its lower edge, a bitmap from its upper."""


def export_mitsuba(source: Source, out: Path) -> LossReport:
    """Write a folder with ``scene.xml``, its maps in OpenEXR and, for Lafortune lobes, a plug-in.

    A distant lamp from above at 45 degrees in whose full light a white board is 1; an orthographic
    eye in front. Lengths are mm. Mitsuba runs ``scene_lafortune.xml`` after ``import lafortune``.
    The loss is that of ``scene.xml``.
    """
    maps = textures(source, "beckmann")
    lit = source.surface
    width = _one_width(maps)
    with export_folder(out) as folder:
        index = maps.lobe.index
        _maps(folder, maps, width, index)
        atomic_bytes(folder / SCENE, _scene(source, _plastic(width, index)).encode())
        lost = list(LOST)
        kept = [
            "normals, diffuse colour and the strength of highlights as floats",
            "the size in mm",
        ]
        if lit.model == "lafortune" and lit.lobes:
            kept.append("all Lafortune lobes, as they are, in scene_lafortune.xml")
            _lafortune(folder, lit, source)
        files = [path for path in folder.rglob("*") if path.is_file()]
        colours = measure(source, shown_by(folder, width, index), oblique=True)
        report = LossReport(
            "Mitsuba", tuple(kept), tuple(lost), files=written(files, folder), **colours
        )
        comment = f"<!-- impasto: {report.summary} -->\n"
        atomic_bytes(folder / SCENE, (comment + _scene(source, _plastic(width, index))).encode())
        report.save(folder / REPORT)
    return report


def _one_width(maps: Textures) -> float:
    """The median width over the light that highlights reflect."""
    energy = (maps.lobe.specular.mean(axis=0)).reshape(-1).astype(np.float64)
    alpha = maps.lobe.alpha.reshape(-1)
    if not energy.any():
        return 0.1
    order = np.argsort(alpha)
    share = np.cumsum(energy[order])
    return float(alpha[order][np.searchsorted(share, 0.5 * share[-1])])


def _maps(folder: Path, maps: Textures, width: float, index: float) -> None:
    # Light crosses the interface on its way in and out: head-on the diffuse colour remains.
    interface = rough_interface(width, index)
    head_on = interface.crossing(np.ones(1))[0]
    through = head_on**2 / index**2 / (1.0 - interface.inside)
    # The same light in a lobe of another width: strength times squared width stays.
    colours = {"diffuse": maps.diffuse / np.float32(through), "specular": maps.lobe.specular}
    for name, planes in colours.items():
        write_exr(folder / f"{name}.exr", dict(zip("RGB", planes, strict=True)))
    coded = (maps.normal + np.float32(1.0)) / np.float32(2.0)
    write_exr(folder / "normal.exr", dict(zip("RGB", coded, strict=True)))


def _plastic(width: float, index: float) -> str:
    return f"""<bsdf type="roughplastic">
                <string name="distribution" value="beckmann"/>
                <float name="alpha" value="{width:.7g}"/>
                <float name="int_ior" value="{index:.7g}"/>
                <float name="ext_ior" value="1"/>
                <boolean name="nonlinear" value="false"/>
                {_bitmap("diffuse_reflectance", "diffuse")}
                {_bitmap("specular_reflectance", "specular")}
            </bsdf>"""


def _bitmap(name: str, file: str) -> str:
    return (
        f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}.exr"/>'
        '<boolean name="raw" value="true"/><string name="filter_type" value="nearest"/>'
        f"{_UV}</texture>"
    )


def _scene(source: Source, bsdf: str) -> str:
    tall, wide = source.size_mm
    rows, columns = source.shape
    light = math.sqrt(0.5)
    return f"""<scene version="3.0.0">
    <!-- x right, y up, z towards the viewer, in mm -->
    <integrator type="direct"/>
    <sensor type="orthographic">
        <transform name="to_world">
            <scale x="{0.5 * wide:.7g}" y="{0.5 * wide:.7g}"/>
            <lookat origin="0, 0, {_EYE_MM:g}" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="{columns}"/>
            <integer name="height" value="{rows}"/>
            <rfilter type="box"/>
        </film>
        <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
    </sensor>
    <emitter type="directional">
        <vector name="direction" x="0" y="{-light:.7g}" z="{-light:.7g}"/>
        <rgb name="irradiance" value="{math.pi:.7g}"/>
    </emitter>
    <shape type="rectangle">
        <transform name="to_world">
            <scale x="{0.5 * wide:.7g}" y="{0.5 * tall:.7g}"/>
        </transform>
        <bsdf type="normalmap">
            <texture type="bitmap" name="normalmap">
                <string name="filename" value="normal.exr"/>
                <boolean name="raw" value="true"/>
                <string name="filter_type" value="nearest"/>
                {_UV}
            </texture>
            {bsdf}
        </bsdf>
    </shape>
</scene>
"""


def _lafortune(folder: Path, lit: Surface, source: Source) -> None:
    """The plug-in, its maps and its scene."""
    texts = []
    diffuse = np.where(source.known, lit.diffuse, np.float32(0.0))
    write_exr(folder / "lafortune_diffuse.exr", dict(zip("RGB", diffuse, strict=True)))
    for number, lobe in enumerate(lit.lobes, 1):
        shape = [np.nan_to_num(np.broadcast_to(one, lit.shape)) for one in lobe.shape]
        strength = np.nan_to_num(np.broadcast_to(lobe.strength, lit.diffuse.shape))
        for name, planes in (("shape", shape), ("strength", list(strength))):
            write_exr(folder / f"{name}_{number}.exr", dict(zip("RGB", planes, strict=True)))
            texts.append(_bitmap(f"{name}_{number}", f"{name}_{number}"))
    texts.append(_bitmap("diffuse", "lafortune_diffuse"))
    bsdf = '<bsdf type="lafortune">' + "".join(texts) + "</bsdf>"
    atomic_bytes(folder / LOBES, _scene(source, bsdf).encode())
    script = resources("impasto.export").joinpath("mitsuba_lafortune.txt").read_bytes()
    atomic_bytes(folder / PLUGIN, script)


def shown_by(folder: Path, width: float, index: float) -> Shown:
    """What ``scene.xml`` shows, from its own maps."""
    diffuse, specular, coded = (
        read_image(folder / f"{name}.exr").reshape(3, -1)
        for name in ("diffuse", "specular", "normal")
    )

    def shown(light: Direction, view: Direction | None, at: NDArray[np.intp]) -> Map:
        normal = np.float32(2.0) * coded[:, at] - np.float32(1.0)
        angles = Angles.of(normal, light, view)
        return rough_plastic(diffuse[:, at], specular[:, at], width, index, angles)

    return shown
