"""A MaterialX document [@materialx] over the pictures of the painting.

Two materials with the same pictures: ``painting`` is a ``standard_surface``, which more programs
read, ``painting_open_pbr`` an ``open_pbr_surface``, which replaces it. Both show one GGX lobe over
a matte base, and the same here.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from impasto.export.folder import export_folder
from impasto.export.loss import REPORT, LossReport, measure, written
from impasto.export.panel_textures import (
    COLOUR,
    FOLDER,
    KEPT,
    LOST,
    NORMAL,
    ROUGHNESS,
    SHINE,
    shown_by,
    write_textures,
)
from impasto.export.source import Source
from impasto.io.files import atomic_bytes

DOCUMENT = "painting.mtlx"
MATERIALS = {
    "painting": ("standard_surface", "base", "specular", "specular_IOR", "normal"),
    "painting_open_pbr": (
        "open_pbr_surface", "base_weight", "specular_weight", "specular_ior", "geometry_normal",
    ),
}  # fmt: skip
"""Materials: the surface, and what it calls its weights, the index of refraction and the normal."""


def export_materialx(source: Source, out: Path) -> LossReport:
    """Write a folder with ``painting.mtlx`` and its textures.

    The strongest highlight sets the index of refraction; ``specular_color`` is the share
    of it that a pixel has. A material has no size: the painting's is in the document's comment.
    """
    with export_folder(out) as folder:
        strongest = write_textures(source, folder, relative=True).strongest
        _write(folder, source, strongest, "")
        files = [path for path in folder.rglob("*") if path.is_file()]
        colours = measure(source, shown_by(folder, strongest), oblique=True)
        lost = (*LOST, "the painting's size, but for a comment: a material has none")
        report = LossReport("MaterialX", KEPT[:1], lost, files=written(files, folder), **colours)
        _write(folder, source, strongest, report.summary)
        report.save(folder / REPORT)
    return report


def index_of(head_on: float) -> float:
    """The index of refraction that reflects this share at normal incidence."""
    root = head_on**0.5
    return float((1.0 + root) / (1.0 - root))


def _write(folder: Path, source: Source, strongest: float, loss: str) -> None:
    root = ET.Element("materialx", version="1.39", colorspace="lin_rec709")
    height, width = source.size_mm
    known = "" if source.pitch_mm else " (1 mm per pixel stands in)"
    root.append(
        ET.Comment(f" impasto: {width:g} x {height:g} mm{known}; {loss.replace('--', '-')} ")
    )
    pictures = (
        ("colour", "color3", COLOUR, "srgb_texture"),
        ("highlight", "color3", SHINE, "srgb_texture"),
        ("roughness", "float", ROUGHNESS, None),
        ("normal_picture", "vector3", NORMAL, None),
    )
    for name, kind, file, space in pictures:
        image = ET.SubElement(root, "image", name=name, type=kind)
        stored = {"name": "file", "type": "filename", "value": f"{FOLDER}/{file}"}
        ET.SubElement(image, "input", stored | ({} if space is None else {"colorspace": space}))
        for mode in ("uaddressmode", "vaddressmode"):
            ET.SubElement(image, "input", name=mode, type="string", value="clamp")
    normal = ET.SubElement(root, "normalmap", name="normal", type="vector3")
    ET.SubElement(normal, "input", name="in", type="vector3", nodename="normal_picture")
    index = f"{index_of(strongest):.7g}"
    for material, (surface, base, specular, ior, facing) in MATERIALS.items():
        shader = ET.SubElement(root, surface, name=f"{material}_surface", type="surfaceshader")
        for name, value in ((base, "1.0"), (specular, "1.0"), (ior, index)):
            ET.SubElement(shader, "input", name=name, type="float", value=value)
        connected = (
            ("base_color", "color3", "colour"),
            ("specular_color", "color3", "highlight"),
            ("specular_roughness", "float", "roughness"),
            (facing, "vector3", "normal"),
        )
        for name, kind, node in connected:
            ET.SubElement(shader, "input", name=name, type=kind, nodename=node)
        own = ET.SubElement(root, "surfacematerial", name=material, type="material")
        lit = {"name": "surfaceshader", "type": "surfaceshader"}
        ET.SubElement(own, "input", lit, nodename=shader.get("name", ""))
    ET.indent(root)
    text = '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
    atomic_bytes(folder / DOCUMENT, text.encode("utf-8"))
