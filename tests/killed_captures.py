"""Captures that are killed on the way, and resumed: no shot is lost but the one at hand.

``python tests/killed_captures.py 20`` kills a capture twenty times, at random steps on the way to
the disk, and says what it saw.
"""

from __future__ import annotations

import hashlib
import os
import random
import signal
import sys
from dataclasses import dataclass, field
from pathlib import Path

import captures
from impasto.capture import Frame, ShotPlan
from impasto.capture.drivers.simulated import SimulatedRig
from killed_jobs import count_steps, in_child, kill


@dataclass(eq=False)
class RememberedRig(SimulatedRig):
    """A rig that writes what it photographs into a file, which outlives its process."""

    memory: Path = field(kw_only=True)

    def trigger(self) -> Frame:
        frame = super().trigger()
        digest = hashlib.sha256(frame.data).hexdigest()
        lamps = ",".join(map(str, self.taken[-1].lamps))
        with self.memory.open("a") as file:
            file.write(f"{digest} {lamps}\n")
        return frame


def remembered(memory: Path) -> dict[str, str]:
    """Lamps by the hash of each photograph, in their order."""
    lines = memory.read_text().splitlines() if memory.exists() else []
    return {digest: lamps for digest, _, lamps in (line.partition(" ") for line in lines)}


def committed(out: Path) -> dict[str, str]:
    """Hashes of the files that the journal of a capture names, by the names of shots."""
    if not (out / "capture" / "journal.jsonl").exists():
        return {}
    try:
        log = captures.log_of(out)
    except Exception as error:  # killed before the first line
        if "no journal" in str(error):
            return {}
        raise
    for entry in log.entries.values():
        data = (out / entry.file).read_bytes()
        assert hashlib.sha256(data).hexdigest() == entry.sha256, entry.name
    return {entry.name: entry.sha256 for entry in log.entries.values()}


@dataclass
class Seen:
    """What was seen: kills, photographs lost by each, wrong pairings at the end."""

    kills: int = 0
    lost: list[int] = field(default_factory=list)
    shots: int = 0
    wrong: int = 0


def killed_and_resumed(folder: Path, shots: ShotPlan, steps: list[int]) -> Seen:
    """Kill a capture before each of these steps (flushes and renames), counted from each start."""
    captures.painting()
    out, memory, seen = folder / "capture", folder / "memory.txt", Seen()

    def run(step: int) -> None:
        if step:
            count_steps(step, kill)
        # Noise of its own for each start, as every photograph has.
        devices = RememberedRig(
            captures.painting(),
            shots.directions,
            seed=len(seen.lost),
            bands=captures.camera(),
            memory=memory,
        )
        captures.taken(shots, devices, out, resume=True)

    for step in steps:
        before, known = committed(out), remembered(memory)
        ended = in_child(lambda step=step: run(step))
        after, photographs = committed(out), remembered(memory)
        assert before.items() <= after.items()
        if ended == 0:
            break
        assert ended == signal.SIGKILL
        seen.kills += 1
        seen.lost.append(len(photographs) - len(known) - (len(after) - len(before)))
    assert in_child(lambda: run(0)) == 0
    lamps, shot_of = remembered(memory), {shot.name: shot for shot in shots}
    found = committed(out)
    seen.shots = len(found)
    seen.wrong = sum(
        lamps[digest] != ("" if shot_of[name].lamp is None else str(shot_of[name].lamp))
        for name, digest in found.items()
    )
    assert not [path for path in out.rglob("*") if ".partial" in path.name]
    return seen


def main(count: int) -> None:
    import tempfile

    shots, rng = captures.plan(170), random.Random(20)
    with tempfile.TemporaryDirectory() as made:
        # Six steps for each of the shots between two kills.
        steps = [rng.randint(1, 6 * (len(shots) // count)) for _ in range(count)]
        seen = killed_and_resumed(Path(made), shots, steps)
    sys.stdout.write(
        f"{seen.kills} kills: at most {max(seen.lost)} photograph lost by each, "
        f"{sum(seen.lost)} in all; {seen.shots} of {len(shots)} shots at the end, {seen.wrong} "
        f"with a wrong lamp; process {os.getpid()}\n"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]))
