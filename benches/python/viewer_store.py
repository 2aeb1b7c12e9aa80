"""How soon a gigapixel is seen: from the command to its address, from the address to the picture.

    python benches/python/viewer_store.py [--side 32768] [--rounds 5] [--write]

``impasto view`` is started as a user starts it, on a store of a job (``large_store.py`` makes one
of 1.07 gigapixels with all its scales, in 0.4 GB). Processor time counts as well: the machine may
do other things. The page is opened in Chromium without a graphics card, in a new profile each time.
``--write`` records benches/results/viewer.json.
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import large_store
from record import run_info, show, write

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import chromium

PROGRAM = "from impasto.cli import main; raise SystemExit(main())"
SIZE = (1300, 800)


def processor_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def once(store: Path, folder: Path, side: int) -> dict[str, float]:
    """Seconds of one start of the command, and of one opening of the page."""
    start = time.perf_counter()
    words = [sys.executable, "-c", PROGRAM, "view", str(store), "--no-browser"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr is not None
        line = ""
        while "http://" not in line:
            line = server.stderr.readline()
            if not line:
                raise RuntimeError("impasto view ended before it printed an address")
        found = {
            "address s": time.perf_counter() - start,
            "processor s": processor_seconds(server.pid),
        }
        with chromium.Chromium(folder, size=SIZE) as browser:
            browser.open("data:text/html,<p>warm", ready="document.readyState === 'complete'")
            for name, view in (("whole", ""), ("detail", f"#view={side / 3},{side / 3},1")):
                before = processor_seconds(server.pid)
                browser.open(f"{line.strip()}{view}")
                found[f"{name}: first ms"] = float(
                    browser.value("document.documentElement.dataset.shown")
                )
                found[f"{name}: complete ms"] = browser.value("performance.now()")
                found[f"{name}: server s"] = processor_seconds(server.pid) - before
        server.send_signal(signal.SIGINT)
        server.wait(30)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=32768)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--store", type=Path, help="one that is there already")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    rounds: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        store = options.store
        if store is None:
            source = large_store.fitted(folder)
            store = large_store.repeated(source, folder / "large.impasto.zarr", options.side)
        rounds += [
            once(store, folder / f"profile{number}", options.side)
            for number in range(options.rounds)
        ]
    rows: list[dict[str, Any]] = [
        {
            "what": what,
            "least": round(min(one[what] for one in rounds), 2),
            "median": round(statistics.median(one[what] for one in rounds), 2),
        }
        for what in rounds[0]
    ]
    show(f"{options.side} x {options.side} pixels, {options.rounds} rounds", rows)
    if options.write:
        run = run_info("python benches/python/viewer_store.py --write")
        write("viewer.json", {"run": run, "side": options.side, "start": rows})


if __name__ == "__main__":
    main()
