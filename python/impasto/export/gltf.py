"""glTF 2.0 in one ``.glb`` [@khronos-gltf]: a panel with the maps of a dielectric.

Metallic-roughness with KHR_materials_ior and KHR_materials_specular, both ratified:
base colour and specular colour in sRGB, normals in tangent space with y up, lengths in metres.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.png import png
from impasto.errors import CorruptInputError
from impasto.export.folder import export_file
from impasto.export.loss import LossReport, Shown, measure, written
from impasto.export.mesh import Grid, panel, relief
from impasto.export.shading import Angles, ggx
from impasto.export.source import Direction, Map, Source
from impasto.export.textures import (
    coded_linear,
    coded_normals,
    coded_srgb,
    decoded_normals,
    decoded_srgb,
    textures,
)
from impasto.io.files import atomic_bytes

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_FLOAT, _UNSIGNED = 5126, 5125
SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}
"""Linear, between linear scales, clamped at the edges."""
MM = 1e-3
"""Metres."""
KEPT = (
    "normals, diffuse colour and one lobe per pixel (GGX), 8 bits each",
    "the colour of highlights, as that of the interface head-on",
    "the painting's size in metres",
)
LOST = (
    "all but one lobe of a pixel, and its shape: facets of GGX have a wider foot",
    "ambient light, which stands in the diffuse colour, the same for all lights",
    "shadows, interreflections and what photographs show besides the model",
    "spectra, illuminants and adaptation: colours are those under D65",
    "reflectance head-on above 1, and colours beyond sRGB",
)


def export_gltf(source: Source, out: Path, *, displaced: bool = False) -> LossReport:
    """Write a ``.glb``.

    Parameters
    ----------
    source
        The painting; without the width of a pixel it is 1 mm per pixel, and the report says so.
    out
        The file.
    displaced
        A mesh that follows the painting's height instead of a flat panel.
    """
    maps = textures(source, "ggx")
    lobe = maps.lobe
    head_on = maps.head_on
    # The interface takes from the diffuse part what it reflects.
    through = np.maximum(1.0 - head_on.max(axis=0), 1e-3)
    factor = max(1.0, float((head_on / lobe.head_on).max(initial=0.0)))
    rough = np.zeros((3, *source.shape), np.float32)
    rough[1] = np.sqrt(lobe.alpha)
    pictures = {
        "normals": coded_normals(maps.normal),
        "base colour": coded_srgb(maps.diffuse / through),
        "roughness": coded_linear(rough),
        "specular colour": coded_srgb(head_on / lobe.head_on / factor),
    }
    # One metre is the format's unit; a relief is shown as it is, in true proportion.
    grid = (relief(source) if displaced else panel(source)).scaled(MM)
    with export_file(out, ".glb") as (path, beside):
        atomic_bytes(path, _document(source, pictures, grid, lobe.index, factor, None))
        report = _report(source, path)
        extras = report.to_dict()
        atomic_bytes(path, _document(source, pictures, grid, lobe.index, factor, extras))
        report.save(beside)
    return report


def _report(source: Source, path: Path) -> LossReport:
    scale = () if source.pitch_mm else ("the painting's size: 1 mm per pixel stands in",)
    kept = KEPT if source.pitch_mm else KEPT[:2]
    shown = shown_by(path.read_bytes(), path)
    colours = measure(source, shown, oblique=True)
    return LossReport("glTF", kept, LOST + scale, files=written([path], path.parent), **colours)


def _document(
    source: Source,
    pictures: dict[str, NDArray[np.uint8]],
    grid: Grid,
    index: float,
    factor: float,
    extras: dict[str, Any] | None,
) -> bytes:
    binary = bytearray()
    views: list[dict[str, Any]] = []

    def stored(data: bytes, **more: Any) -> int:
        binary.extend(b"\0" * (-len(binary) % 4))
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data), **more})
        binary.extend(data)
        return len(views) - 1

    accessors: list[dict[str, Any]] = []

    def accessor(values: NDArray[Any], kind: str, *, indices: bool = False) -> int:
        view = stored(values.tobytes(), target=34963 if indices else 34962)
        one: dict[str, Any] = {
            "bufferView": view,
            "componentType": _UNSIGNED if indices else _FLOAT,
            "count": values.size if indices else len(values),
            "type": kind,
        }
        if kind == "VEC3" and "POSITION" not in {a.get("name") for a in accessors}:
            one |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
            one["name"] = "POSITION"
        accessors.append(one)
        return len(accessors) - 1

    tangent = np.tile(np.array([1, 0, 0, 1], np.float32), (len(grid.points), 1))
    attributes = {
        "POSITION": accessor(grid.points, "VEC3"),
        # The painting's own normals are in the texture; those of the panel are its frame.
        "NORMAL": accessor(np.tile(np.array([0, 0, 1], np.float32), (len(grid.points), 1)), "VEC3"),
        "TANGENT": accessor(tangent, "VEC4"),
        "TEXCOORD_0": accessor(grid.texture, "VEC2"),
    }
    primitive = {
        "attributes": attributes,
        "indices": accessor(grid.triangles.reshape(-1), "SCALAR", indices=True),
        "material": 0,
    }
    images = []
    for name, planes in pictures.items():
        view = stored(png(np.ascontiguousarray(np.moveaxis(planes, 0, -1))))
        images.append({"bufferView": view, "mimeType": "image/png", "name": name})
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "impasto"},
        "extensionsUsed": ["KHR_materials_ior", "KHR_materials_specular"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": source.name}],
        "meshes": [{"primitives": [primitive], "name": source.name}],
        "materials": [_material(source.name, index, factor)],
        "textures": [{"source": number, "sampler": 0} for number in range(len(images))],
        "images": images,
        "samplers": [SAMPLER],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    if extras is not None:
        document["asset"]["extras"] = {"loss": extras}
    return _packed(document, bytes(binary))


def _material(name: str, index: float, factor: float) -> dict[str, Any]:
    return {
        "name": name,
        "normalTexture": {"index": 0},
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 1},
            "metallicRoughnessTexture": {"index": 2},
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        },
        "extensions": {
            "KHR_materials_ior": {"ior": index},
            "KHR_materials_specular": {
                "specularColorTexture": {"index": 3},
                "specularColorFactor": [factor] * 3,
            },
        },
    }


def _packed(document: dict[str, Any], binary: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    head = struct.pack("<4sII", b"glTF", 2, total)
    return (
        head
        + struct.pack("<II", len(text), _JSON)
        + text
        + struct.pack("<II", len(binary), _BINARY)
        + binary
    )


def unpacked(data: bytes, path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary part of a ``.glb``.

    Raises
    ------
    CorruptInputError
        No ``.glb`` of version 2.
    """
    if data[:8] != struct.pack("<4sI", b"glTF", 2) or len(data) < 28:
        raise CorruptInputError(path, "is no binary glTF 2.0")
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def shown_by(data: bytes, path: Path) -> Shown:
    """What a ``.glb`` of this module shows, from its own textures."""
    import cv2

    document, binary = unpacked(data, path)

    def texture(number: int) -> NDArray[np.uint8]:
        view = document["bufferViews"][document["images"][number]["bufferView"]]
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        found = cv2.imdecode(np.frombuffer(part, np.uint8), cv2.IMREAD_COLOR)
        return np.ascontiguousarray(np.moveaxis(np.asarray(found)[..., ::-1], -1, 0)).reshape(3, -1)

    normals, base, rough, colour = (texture(number) for number in range(4))
    extensions = document["materials"][0]["extensions"]
    index = extensions["KHR_materials_ior"]["ior"]
    factor = extensions["KHR_materials_specular"]["specularColorFactor"][0]
    head_on = ((index - 1.0) / (index + 1.0)) ** 2

    def shown(light: Direction, view: Direction | None, at: NDArray[np.intp]) -> Map:
        specular = np.minimum(np.float32(head_on * factor) * decoded_srgb(colour[:, at]), 1.0)
        alpha = np.square(rough[1, at].astype(np.float32) / np.float32(255.0))
        angles = Angles.of(decoded_normals(normals[:, at]), light, view)
        return ggx(decoded_srgb(base[:, at]), specular, alpha, angles)

    return shown
