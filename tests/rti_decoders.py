"""Decoders of RTI files from their descriptions alone, which share no code with impasto.

Sources: Malzbender, Gelb and Wolters (2001) and HP's description of PTM 1.2; the universal RTI
format of Cultural Heritage Imaging; the ``info.json`` of relight.
"""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np


def lines(data: bytes, count: int) -> tuple[list[str], bytes]:
    """The first lines of a file, and what follows."""
    found = []
    for _ in range(count):
        line, data = data.split(b"\n", 1)
        found.append(line.decode().strip())
    return found, data


class Ptm:
    """PTM 1.2, RGB or LRGB, raw."""

    def __init__(self, path: Path) -> None:
        head, body = lines(path.read_bytes(), 6)
        assert head[0] == "PTM_1.2"
        self.kind = head[1]
        self.width, self.height = int(head[2]), int(head[3])
        self.scale = [float(word) for word in head[4].split()]
        self.bias = [int(word) for word in head[5].split()]
        self.body = body
        pixels = self.width * self.height
        assert len(body) == pixels * {"PTM_FORMAT_RGB": 18, "PTM_FORMAT_LRGB": 9}[self.kind]

    def shown(self, y: int, x: int, light: tuple[float, float, float]) -> list[float]:
        """0 to 255 in red, green and blue; ``y`` counts from the top."""
        u, v = light[0], light[1]
        functions = [u * u, v * v, u * v, u, v, 1.0]
        pixel = (self.height - 1 - y) * self.width + x
        pixels = self.width * self.height

        def polynomial(start: int) -> float:
            codes = self.body[start : start + 6]
            return sum(
                (code - bias) * scale * one
                for code, bias, scale, one in zip(
                    codes, self.bias, self.scale, functions, strict=True
                )
            )

        if self.kind == "PTM_FORMAT_RGB":
            return [polynomial(6 * (channel * pixels + pixel)) for channel in range(3)]
        luminance = polynomial(6 * pixel)
        colour = self.body[6 * pixels + 3 * pixel :][:3]
        return [luminance / 255.0 * one for one in colour]


def harmonics(light: tuple[float, float, float]) -> list[float]:
    """Nine hemispherical harmonics by angles, as they are usually written."""
    x, y, z = light
    theta = min(math.acos(z), math.pi / 2 - 0.01)
    phi = math.atan2(y, x)
    c = math.cos(theta)
    s = math.sqrt(c - c * c)
    pi = math.pi
    return [
        1 / math.sqrt(2 * pi),
        math.sqrt(6 / pi) * math.cos(phi) * s,
        math.sqrt(3 / (2 * pi)) * (2 * c - 1),
        math.sqrt(6 / pi) * math.sin(phi) * s,
        math.sqrt(30 / pi) * math.cos(2 * phi) * (c * c - c),
        math.sqrt(30 / pi) * math.cos(phi) * (2 * c - 1) * s,
        math.sqrt(5 / (2 * pi)) * (1 - 6 * c + 6 * c * c),
        math.sqrt(30 / pi) * math.sin(phi) * (2 * c - 1) * s,
        math.sqrt(30 / pi) * math.sin(2 * phi) * (c * c - c),
    ]


class Rti:
    """Universal RTI of hemispherical harmonics, RGB."""

    def __init__(self, path: Path) -> None:
        head, body = lines(path.read_bytes(), 4)
        assert head[0].startswith("#HSH")
        assert head[1] == "3"
        self.width, self.height, channels = map(int, head[2].split())
        self.terms, colours, size = map(int, head[3].split())
        assert (channels, colours, size) == (3, 2, 1)
        numbers = struct.unpack(f"<{2 * self.terms}f", body[: 8 * self.terms])
        self.scale, self.bias = numbers[: self.terms], numbers[self.terms :]
        self.body = body[8 * self.terms :]
        assert len(self.body) == self.width * self.height * 3 * self.terms

    def shown(self, y: int, x: int, light: tuple[float, float, float]) -> list[float]:
        """0 to 1 in red, green and blue; ``y`` counts from the top."""
        start = 3 * self.terms * (y * self.width + x)
        functions = harmonics(light)[: self.terms]
        found = []
        for channel in range(3):
            codes = self.body[start + channel * self.terms :][: self.terms]
            coded = zip(codes, self.scale, self.bias, functions, strict=True)
            found.append(sum((code / 255 * scale + bias) * one for code, scale, bias, one in coded))
        return found


class Relight:
    """``info.json`` with polynomials or hemispherical harmonics in RGB."""

    def __init__(self, folder: Path) -> None:
        self.info: dict[str, Any] = json.loads((folder / "info.json").read_text())
        assert self.info["colorspace"] == "rgb"
        self.planes: list[np.ndarray] = []
        for number in range(math.ceil(self.info["nplanes"] / 3)):
            picture = cv2.imread(str(folder / f"plane_{number}.{self.info['format']}"))
            assert picture is not None
            blue, green, red = cv2.split(picture)
            self.planes += [red, green, blue]

    def shown(self, y: int, x: int, light: tuple[float, float, float]) -> list[float]:
        """0 to 1 in red, green and blue."""
        u, v = light[0], light[1]
        ptm = [1.0, u, v, u * u, u * v, v * v]
        functions = ptm if self.info["type"] == "ptm" else harmonics(light)
        material = self.info["materials"][0]
        found = [0.0, 0.0, 0.0]
        for plane in range(self.info["nplanes"]):
            code = int(self.planes[plane][y, x]) / 255
            coefficient = (code - material["bias"][plane]) * material["scale"][plane]
            found[plane % 3] += functions[plane // 3] * coefficient
        return found


class OpenLime:
    """OpenLIME's BRDF layer: four pictures, ``alphaLimits`` and ``colorspaces``."""

    def __init__(self, folder: Path) -> None:
        content = json.loads((folder / "layers.json").read_text())
        self.brightness = content["brightness"]
        self.layer = content["layers"]["brdf"]
        self.pictures = {
            name: cv2.imread(str(folder / file), cv2.IMREAD_COLOR)
            for name, file in self.layer["channels"].items()
        }

    def shown(self, y: int, x: int, light: tuple[float, float, float]) -> list[float]:
        """Linear red, green and blue of a lamp without fall-off."""

        def colour(name: str) -> list[float]:
            picture = self.pictures[name]
            assert picture is not None
            codes = [int(one) / 255 for one in picture[y, x][::-1]]
            if self.layer["colorspaces"].get(name, "srgb") == "linear" or name in {
                "normals",
                "gloss",
            }:
                return codes
            return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in codes]

        narrow, wide = self.layer["alphaLimits"]
        least, greatest = 1 - wide**0.25, 1 - narrow**0.25
        alpha = (1 - colour("gloss")[0] * (greatest - least) - least) ** 4
        normal = [2 * one - 1 for one in colour("normals")]
        length = math.sqrt(sum(one * one for one in normal))
        nx, ny, nz = (one / length for one in normal)
        half = (light[0], light[1], light[2] + 1.0)
        size = math.sqrt(sum(one * one for one in half))
        nh = (nx * half[0] + ny * half[1] + nz * half[2]) / size
        nl = max(nx * light[0] + ny * light[1] + nz * light[2], 0.0)
        lobe = 0.0
        if nl * nz > 0.0 and (alpha * nh) ** 2 >= 1e-5:
            tangent = math.tan(math.acos(min(nh, 1.0)))
            lobe = math.exp(-((tangent / alpha) ** 2))
            lobe /= 4 * math.pi * alpha**2 * math.sqrt(nl * nz)
        ambient = self.layer["kAmbient"]
        pairs = zip(colour("kd"), colour("ks"), strict=True)
        return [(kd / math.pi + ks * lobe) * nl + kd / math.pi * ambient for kd, ks in pairs]
