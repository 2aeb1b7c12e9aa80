"""What every test may use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import chromium

SLOW = {
    "test_advice", "test_before_fit", "test_calls", "test_inputs", "test_lafortune",
    "test_lafortune_covariance", "test_lafortune_few", "test_masks", "test_metamorphic",
    "test_rig_refinement", "test_simulate", "test_simulate_capture", "test_stored",
    "test_strengths", "test_study_costs", "test_study_excess", "test_study_journal",
    "test_study_own", "test_study_recorded", "test_stubs", "test_suggestions", "test_systems",
    "test_tone",
}  # fmt: skip
"""Files of which most tests are slow; in other files each slow test has its own mark."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of slow files; ``make test-fast`` leaves them out."""
    here = Path(__file__).parent
    if gone := sorted(name for name in SLOW if not (here / f"{name}.py").is_file()):
        raise pytest.UsageError(f"tests/conftest.py: SLOW names files that are gone: {gone}")
    for item in items:
        if item.path.stem in SLOW:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    """Chromium for the tests of a file, which may have one of another size."""
    chromium.needed()
    folder = tmp_path_factory.mktemp("profile")
    with chromium.Chromium(folder, size=(800, 420)) as started:
        yield started


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real photographs and spectra; they are not part of the project.

    ``IMPASTO_DATA`` names it; otherwise it is looked for beside the checkout. Where the data must
    be there, ``IMPASTO_EXPECT_DATA=1`` turns the skip into a failure.
    """
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("IMPASTO_DATA", root.parent / "shared" / "data"))
    if folder.is_dir():
        return folder
    message = f"real photographs and spectra are not at {folder} (set IMPASTO_DATA)"
    if os.environ.get("IMPASTO_EXPECT_DATA") == "1":
        pytest.fail(message)
    pytest.skip(message)
