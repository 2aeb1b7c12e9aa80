"""The page "How do I ...?": every recipe runs as it stands, on files of the kind that it names."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import recipe_files
import recipes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where all recipes ran, one after the other."""
    before, folder = Path.cwd(), tmp_path_factory.mktemp("recipes")
    recipe_files.write_files(folder)
    os.chdir(folder)
    try:
        recipes.run()
        yield folder
    finally:
        os.chdir(before)


def test_recipes_run(folder: Path) -> None:
    assert (folder / "page" / "index.html").is_file()
