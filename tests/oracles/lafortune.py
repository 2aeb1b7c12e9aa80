"""Write `crates/impasto/tests/brdf/lafortune.txt`: 86 published Lafortune fits in 50 digits.

Usage: `python tests/oracles/lafortune.py TABLE.csv`, the one-lobe fits to measured materials of
Ngan, Durand and Matusik 2005 (green channel), as tabulated in bsdfbenchmark/bbm. Their formula,

    kd/pi + ks (n+2) / (2 pi max(|cz|, |cxy|)^n) [cxy (lx vx + ly vy) + cz lz vz]^n

is evaluated with Python's `decimal`, which shares no line with impasto, for directions that single
precision holds exactly; the normal is tilted by taking components along it and across it. Lines:

    pair NX NY NZ  LX LY LZ  VX VY VZ
    fit NAME kd ks cxy cz n  VALUE of each pair
"""

from __future__ import annotations

import csv
import math
import struct
import sys
from decimal import Decimal, getcontext
from pathlib import Path

OUT = Path(__file__).parents[2] / "crates" / "impasto" / "tests" / "brdf" / "lafortune.txt"
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459")
Vector = tuple[float, float, float]


def single(angle: float, azimuth: float) -> Vector:
    """A direction, degrees from z and from x, rounded to single precision."""
    a, b = math.radians(angle), math.radians(azimuth)
    exact = (math.sin(a) * math.cos(b), math.sin(a) * math.sin(b), math.cos(a))
    x, y, z = struct.unpack("3f", struct.pack("3f", *exact))
    return x, y, z


def dot(a: Vector, b: Vector) -> Decimal:
    return sum((Decimal(x) * Decimal(y) for x, y in zip(a, b, strict=True)), Decimal(0))


def value(fit: dict[str, str], normal: Vector, light: Vector, view: Vector) -> Decimal:
    kd, ks, n = (Decimal(fit[key]) for key in ("kd_g", "ks_g", "exponent"))
    cxy, cz = Decimal(fit["cxy"]), Decimal(fit["cz"])
    upright = dot(normal, light) * dot(normal, view)
    base = cxy * (dot(light, view) - upright) + cz * upright
    if base <= 0:
        return kd / PI
    length = max(abs(cxy), abs(cz))
    return kd / PI + ks * (n + 2) / (2 * PI) * (n * (base / length).ln()).exp()


def pairs() -> list[tuple[Vector, Vector, Vector]]:
    up = (0.0, 0.0, 1.0)
    mirror = [(up, single(30 + off, 10), single(30, 190)) for off in (0, 0.05, 0.5, 2, 10, 40)]
    steep = [(up, single(80, 0), single(80 - off, 180)) for off in (0, 1)]
    back = [(up, single(45, 20), single(45, 20)), (up, single(60, 0), single(50, 90))]
    tilted = [(single(12, 70), single(30, 40), single(a, 130)) for a in (8, 12, 25)]
    return mirror + steep + back + tilted + [(up, up, up)]


def main() -> None:
    getcontext().prec = 50
    with Path(sys.argv[1]).open(encoding="utf-8", newline="") as table:
        fits = list(csv.DictReader(table))
    rows = ["# Written by tests/oracles/lafortune.py: Ngan et al. 2005, green channel."]
    rows += ["pair " + " ".join(repr(x) for vector in pair for x in vector) for pair in pairs()]
    for fit in fits:
        constants = [fit[key] for key in ("kd_g", "ks_g", "cxy", "cz", "exponent")]
        values = [f"{value(fit, *pair):.18e}" for pair in pairs()]
        rows.append(" ".join(["fit", fit["material"], *constants, *values]))
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text("\n".join(rows) + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
