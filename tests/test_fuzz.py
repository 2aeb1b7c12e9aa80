"""Some cases of the fuzzer of readers; ``fuzz_readers.py`` makes any number of them."""

from __future__ import annotations

from pathlib import Path

import pytest

import fuzz_mutations
import fuzz_readers

pytestmark = pytest.mark.slow

CASES = {"csv": 40, "camera": 30, "txt": 60, "result": 40, "learned": 40, "region": 50, "array": 40}
"""Fewer where fields of 140,000 characters or many arrays take their time."""
OTHERS = 70
READERS = (
    *("png", "jpeg", "tiff", "exr", "hdr", "lp", "txt", "csv", "dome", "relight", "alicevision"),
    *("camera", "spectra", "display", "report", "session", "stack", "region", "result", "learned"),
    *("record", "journal", "store", "array", "lens", "alignment", "depth", "points"),
    *("tone", "shots", "capture", "ptm", "rti", "relightable"),
)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, fuzz_mutations.Reader]:
    return fuzz_readers.readers(tmp_path_factory.mktemp("seeds"))


def test_every_reader_is_tried(known: dict[str, fuzz_mutations.Reader]) -> None:
    assert tuple(known) == READERS


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_ends_in_words(
    name: str, known: dict[str, fuzz_mutations.Reader], tmp_path: Path
) -> None:
    reader = known[name]
    count = CASES.get(name, OTHERS)
    tally = fuzz_readers.run(reader, name, 1, iter(range(count)), tmp_path / f"a{reader.suffix}")
    assert tally.faults == []
    assert sum(tally.outcomes.values()) == count
    assert len(tally.outcomes) > 1, "some can be read, others cannot"


def test_a_fault_is_found(tmp_path: Path) -> None:
    def fails(path: Path) -> None:
        if path.read_bytes() != b"good":
            raise LookupError

    reader = fuzz_mutations.Reader(".x", [b"good"], fails)
    tally = fuzz_readers.run(reader, "x", 1, iter(range(20)), tmp_path / "a.x")
    assert tally.outcomes["fault"] > 10
    assert tally.faults[0].startswith("x --seed 1 --only ")


def test_batches_side_by_side_have_the_same_tally(
    known: dict[str, fuzz_mutations.Reader], tmp_path: Path
) -> None:
    here = fuzz_readers.run(known["lp"], "lp", 1, iter(range(3, 43)), tmp_path / "a.lp")
    apart = fuzz_readers.for_cases("lp", seed=1, first=3, count=40, processes=3)
    assert apart.outcomes == here.outcomes
    assert apart.faults == here.faults == []
    assert apart.seconds > 0.0
