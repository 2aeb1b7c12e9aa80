"""Each bound of a plan on many generated tiles: none is exceeded, and how loose those of lobes are.

    python benches/python/bounds.py --tiles 1000000 --record

Runs the tests of ``crates/impasto/src/relight/bounds.rs`` with so many tiles; they fail where one
value exceeds its bound. A million take three minutes.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
from typing import Any

import record

COMMAND = "cargo test --release --quiet --package impasto --lib relight::bounds -- --nocapture"


def measured(tiles: int) -> list[dict[str, Any]]:
    """The median of bound over largest value, in tiles that see the lobe."""
    done = subprocess.run(
        COMMAND.split(),
        env={**os.environ, "IMPASTO_TILES": str(tiles)},
        cwd=record.ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(done.stdout + done.stderr)
    found = re.findall(r"(Lafortune|Torrance-Sparrow): ([0-9.]+) of (\d+) tiles", done.stdout)
    return [
        {"lobe": lobe, "tiles": tiles, "seen_in": int(seen), "median_looseness": float(median)}
        for lobe, median, seen in sorted(found)
    ]


def main() -> None:
    """Measure, print, and record if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tiles", type=int, default=20_000)
    parser.add_argument("--record", action="store_true")
    chosen = parser.parse_args()
    rows = measured(chosen.tiles)
    record.show("Bound over largest value", rows)
    if chosen.record:
        command = f"python benches/python/bounds.py --tiles {chosen.tiles} --record"
        record.write("bounds.json", {"run": record.run_info(command), "bounds": rows})


if __name__ == "__main__":
    main()
