"""What every test may use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


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
