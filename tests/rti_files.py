"""Small RTI files for tests and the fuzzer of readers."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np

from fuzz_mutations import Reader
from impasto.io.rti import (
    Basis,
    RelightableImage,
    quantised,
    read_ptm,
    read_relight,
    read_rti,
    write_ptm,
    write_relight,
    write_rti,
)

ROWS, COLUMNS = 5, 7


def relightable(kind: str = "ptm", *, file: bool = True) -> RelightableImage:
    """Every coefficient different, so that no order of rows, channels or functions is another."""
    basis = Basis(kind, {"ptm": 6, "hsh": 9}[kind])  # type: ignore[arg-type]
    rng = np.random.default_rng(5)
    coefficients = rng.normal(0.3, 0.4, (basis.terms, 3, ROWS, COLUMNS)).astype(np.float32)
    return quantised(coefficients, basis, shared=file, whole=file and kind == "ptm", pitch_mm=0.25)


def compressed(path: Path, *, corrections: bytes = b"", reference: int = -1) -> np.ndarray:
    """A JPEG_LRGB by the description: plane 1 perhaps as a difference from plane 0."""
    rng = np.random.default_rng(3)
    smooth = [cv2.resize(rng.integers(40, 200, (2, 2), dtype=np.uint8), (16, 8)) for _ in range(9)]
    jpegs = [cv2.imencode(".jpg", plane, [cv2.IMWRITE_JPEG_QUALITY, 95])[1] for plane in smooth]
    planes = np.stack([cv2.imdecode(one, cv2.IMREAD_UNCHANGED) for one in jpegs])
    references = [-1] * 9
    if reference >= 0:
        references[1] = reference
        planes[1] = planes[1] - np.uint8(128) + planes[reference]
    patches = [0] * 9
    patches[2] = len(corrections)
    # Plane 1 is decoded last, after whatever it refers to.
    order = [0, 8, 1, 2, 3, 4, 5, 6, 7]
    body = b"".join(
        one.tobytes() + (corrections if number == 2 else b"") for number, one in enumerate(jpegs)
    )
    table = ([0] * 9, [0] * 9, [0] * 9, order, references, [len(one) for one in jpegs], patches)
    head = "PTM_1.2 \nPTM_FORMAT_JPEG_LRGB\n16 8\n1 1 1 1 1 2\n128 128 128 128 128 0\n95\n"
    head += "".join(" ".join(map(str, line)) + "\n" for line in table)
    path.write_bytes(head.encode() + body)
    return planes


def rti_readers(folder: Path) -> dict[str, Reader]:
    """The readers of RTI files, for the fuzzer; what they return is lit."""
    write_ptm(folder / "rgb.ptm", relightable("ptm"))
    compressed(folder / "jpeg.ptm", reference=0)
    write_rti(folder / "hsh.rti", relightable("hsh"))
    infos = []
    for kind in ("ptm", "hsh"):
        beside = folder / f"relight-{kind}"
        beside.mkdir()
        write_relight(beside, relightable(kind, file=False))
        infos.append((beside / "info.json").read_bytes())

    def lit(image: RelightableImage) -> None:
        image.values((0.0, 0.6, 0.8))

    def read_info(path: Path) -> None:
        if not path.with_name("plane_0.jpg").exists():
            for plane in (folder / "relight-hsh").glob("plane_*.jpg"):
                shutil.copy(plane, path.parent)
        lit(read_relight(path))

    ptm = [(folder / name).read_bytes() for name in ("rgb.ptm", "jpeg.ptm")]
    return {
        "ptm": Reader(".ptm", ptm, lambda path: lit(read_ptm(path))),
        "rti": Reader(".rti", [(folder / "hsh.rti").read_bytes()], lambda p: lit(read_rti(p))),
        "relightable": Reader(".json", infos, read_info, text=True),
    }
