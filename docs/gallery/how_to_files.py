"""Pictures of files that recipes of how-to.md have written, read from the files alone."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from impasto.pictures import Panel, Picture

GLB = struct.Struct("<4sII")
"""Head of a glTF binary: its name, version and length; chunks follow [@khronos-gltf]."""
CHUNK = struct.Struct("<II")
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""Of a binary STL, after 80 bytes and a count."""


def textures(path: Path) -> list[Panel]:
    """The pictures in a glTF binary, under the names of its material."""
    data = path.read_bytes()
    length, _ = CHUNK.unpack_from(data, GLB.size)
    start = GLB.size + CHUNK.size
    scene = json.loads(data[start : start + length])
    held = data[start + length + CHUNK.size :]
    (material,) = scene["materials"]
    base = material["pbrMetallicRoughness"]
    shown = {
        "Colour": base["baseColorTexture"],
        "Roughness": base["metallicRoughnessTexture"],
        "Normals": material["normalTexture"],
    }
    found = {name: _image(scene, held, texture["index"]) for name, texture in shown.items()}
    # Green holds the roughness, blue whether it is metal.
    found["Roughness"] = np.repeat(found["Roughness"][..., 1:2], 3, axis=2)
    return [
        Panel(name, picture, _kind(scene, shown[name]["index"])) for name, picture in found.items()
    ]


def _source(scene: Any, texture: int) -> Any:
    return scene["images"][scene["textures"][texture]["source"]]


def _kind(scene: Any, texture: int) -> str:
    return str(_source(scene, texture)["mimeType"]).removeprefix("image/").upper()


def _image(scene: Any, held: bytes, texture: int) -> Picture:
    view = scene["bufferViews"][_source(scene, texture)["bufferView"]]
    start = view.get("byteOffset", 0)
    codes = cv2.imdecode(
        np.frombuffer(held[start : start + view["byteLength"]], np.uint8), cv2.IMREAD_COLOR
    )
    assert codes is not None
    return np.ascontiguousarray(codes[..., ::-1])


def facets(path: Path, light: tuple[float, float, float]) -> tuple[Picture, tuple[float, ...]]:
    """The facets of a binary STL from the front, each as a lamp lights it; and its size in mm."""
    data = path.read_bytes()
    found = np.frombuffer(data, FACET, int.from_bytes(data[80:84], "little"), 84)
    corners = found["corners"].astype(np.float64)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    front = across[:, 2] > 0.05
    shade = np.clip(across[front] @ np.array(light) / np.linalg.norm(light), 0.0, 1.0)
    scale = 640.0 / (high[0] - low[0])
    rows = round(scale * (high[1] - low[1]))
    picture: NDArray[np.uint8] = np.full((rows, 640, 3), 38, np.uint8)
    flat = (corners[front, :, :2] - low[:2]) * scale
    flat[..., 1] = rows - flat[..., 1]
    for triangle, value in zip(np.rint(flat).astype(np.int32), shade.tolist(), strict=True):
        grey = round(255.0 * value ** (1 / 2.2))
        cv2.fillConvexPoly(picture, triangle, (grey, grey, grey))
    return picture, tuple((high - low).tolist())
