"""Good files of lenses, alignments and captures for the fuzzer of readers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

import impasto
from fuzz_mutations import Reader, leaves_changed, line_changed
from impasto import io
from impasto.align import read_points
from impasto.align.layout import SIDES
from impasto.capture import plan_shots, read_shots, write_shots
from impasto.capture.journal import CaptureLog, Entry, read_log
from impasto.capture.misfires import Misfire
from impasto.depth_mesh import DepthMesh
from impasto.io import json_lines
from impasto.io.depth_mesh import write_depth
from impasto.io.session_toml import session_text
from impasto.io.tone_curve import read_tone_curve, write_tone_curve
from impasto.lens import Lens

SIZE = (10, 12)
LIGHTS = [(0.5, 0, 0.9), (0, 0.5, 0.9), (-0.5, 0, 0.9), (0, -0.5, 0.9), (0, 0, 1)]


def optics(folder: Path) -> dict[str, Reader]:
    """Lens, alignment and relief, of which a session's photographs are resampled as they say."""
    home = folder / "optics"
    home.mkdir()
    names = [f"{i}.png" for i in range(len(LIGHTS))]
    for i, name in enumerate(names):
        io.write_png8(home / name, np.full(SIZE, 40 * i + 40, np.uint8))
    io.write_lights(home / "a.lp", LIGHTS, names)
    matrix = np.array([[20.0, 0.0, 5.5], [0.0, 20.0, 4.5], [0.0, 0.0, 1.0]])
    places = np.array([0.01, 0.0, 0.001, 0.0, 0.0])
    lenses = [
        Lens("radial", (12, 10), matrix, places, np.ones(4), np.zeros(5), 0.1, 10, 400),
        Lens("brown", (12, 10), matrix, places, np.ones(4), np.zeros(5), 0.1, 10, 400),
    ]
    for lens in reversed(lenses):
        lens.save(home / f"{lens.model}.json")
    bent = np.array([[0.0, 0.1, 0.2], [0.3, 0.1, 0.0]])
    mesh = DepthMesh((12.0, 10.0), bent, np.where(bent > 0.2, np.nan, 0.01))
    write_depth(home / "depth.csv", mesh)
    plane = [[1.0, 0.0, 5.5], [0.0, -1.0, 4.5], [0.0, 0.0, 1.0]]
    camera = {"camera_mm": [0, 0, 20], "camera_rotation": np.diag([1.0, -1.0, -1.0]).tolist()}
    report = {
        "kind": "impasto alignment", "version": 1, "size_mm": [12.0, 10.0], "pixel_mm": 1.0,
        "size_px": [12, 10], "lens": {"model": "radial", "residual_px": 0.1}, "depth": {},
        "photographs": [
            {"source": name, "homography": plane, "shift_px": [0.1, 0.0] if i else None, **camera}
            for i, name in enumerate(names)
        ],
    }  # fmt: skip
    usual = {"lights": "a.lp", "lens": "radial.json"}
    seeds = {"alignment.json": report, "flat.json": report | {"depth": None}}
    for name, content in seeds.items():
        (home / name).write_text(json.dumps(content))

    def reader(name: str, seeds: list[bytes], **values: str) -> Reader:
        text = session_text(io.Session(**{**usual, **values}))

        def read(path: Path) -> None:
            """The other files of the session lie beside the damaged one."""
            good = (home / name).read_bytes()
            (home / "session.toml").write_text(text)
            try:
                (home / name).write_bytes(path.read_bytes())
                impasto.read_stack(home)
            finally:
                (home / name).write_bytes(good)

        json_like = Path(name).suffix == ".json"
        options = {"repair": leaves_changed} if json_like else {}
        return Reader(Path(name).suffix, seeds, read, text=True, **options)

    corners = dict(zip(SIDES, ([1, 1], [10.5, 1], [10, 8], [1, 8]), strict=True))
    points = {"size_mm": [12, 10], "photographs": {"default": corners}, "kind": "disc"}
    named = points | {"points_mm": {k: [i, i * i] for i, k in enumerate(SIDES)}, "search_px": 5}
    marks = [json.dumps(one).encode() for one in (points, named)]
    reports = [json.dumps(one).encode() for one in seeds.values()]
    lens_files = [(home / f"{lens.model}.json").read_bytes() for lens in lenses]
    return {
        "lens": reader("radial.json", lens_files),
        "alignment": reader("alignment.json", reports, alignment="alignment.json"),
        "depth": reader("depth.csv", [(home / "depth.csv").read_bytes()],
                        alignment="alignment.json"),
        "points": Reader(".json", marks, read_points, True, leaves_changed),
    }  # fmt: skip


def captures(folder: Path) -> dict[str, Reader]:
    """Tone curves, plans of shots and journals of captures."""
    write_tone_curve(folder / "tone.json", [0.0, 0.3, 0.7, 1.0], [0.0, 0.1, 0.5, 1.0])
    write_shots(folder / "far.toml", plan_shots(io.read_lights(folder / "session" / "a.lp")))
    shots = [(folder / "far.toml").read_bytes()]
    shots.append(shots[0].replace(b"directions", b"positions_mm").replace(
        b"exposure_s = 0.01\n", b"exposure_s = 0.01\nview = [0, 0, 1]\nangles = { stage = 0.1 }\n"
    ))  # fmt: skip
    lights = io.read_lights(folder / "session" / "a.lp")
    write_shots(folder / "bracket.toml", plan_shots(lights, exposure_s=(0.002, 0.008)))
    shots.append((folder / "bracket.toml").read_bytes())
    entry = Entry("a", "photographs/a.tif", "0" * 64, 1, 0.01, 1.7e9, 2, 0.5)
    odd = vars(Misfire("dark", "no lamp", "look"))
    lines: list[dict[str, Any]] = [
        {"plan": "0" * 64}, {"tried": "a", **odd}, {"shot": vars(entry)}, {"failed": "b", **odd},
        {"note": "drift", "text": "a"}, {"session": "1" * 64},
        {"shot": vars(entry) | {"name": "dark", "lamp": None}},
    ]  # fmt: skip
    journal = b"".join(json_lines.sealed_line(line) for line in lines)
    return {
        "tone": Reader(
            ".json", [(folder / "tone.json").read_bytes()], read_tone_curve, True, leaves_changed
        ),
        "shots": Reader(".toml", shots, read_shots, text=True),
        "capture": Reader(".jsonl", [journal], _capture, text=True, repair=line_changed),
    }


def _capture(path: Path) -> CaptureLog:
    """What is used of a journal: numbers are numbers, names are texts."""
    log = read_log(path)
    for one in log.entries.values():
        if one.lamp is not None:
            _ = one.lamp + one.tries
        _ = one.exposure_s * one.time * one.level
        _ = Path(one.name) / one.file / one.sha256
    return log
