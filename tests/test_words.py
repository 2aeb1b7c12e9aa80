"""Known things carry the names that the literature gives them: no private words in code.

Only names of files, functions and variables are checked. Prose may use any English word.
"""

from __future__ import annotations

import io
import re
import subprocess
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

PRIVATE = {
    "aside": "consensus",
    "asked": "sampled",
    "climb": "forward selection",
    "climber": "forward selection",
    "complaints": "native stderr",
    "deal": "split",
    "dealt": "split",
    "easel": "painting",
    "foretold": "predicted",
    "grain": "noise floor",
    "gross": "outlier",
    "hands": "subsets",
    "hear": "estimate",
    "heard": "equations",
    "hears": "estimate",
    "ladder": "by lobe count",
    "matt": "diffuse",
    "plate": "samples",
    "pyramid": "seeds",
    "rungs": "estimates",
    "settle": "irls, reweight, refine",
    "settled": "irls, reweight, refine",
    "specimen": "data set, sampled tiles",
    "specimens": "data sets",
    "told": "text, or a from/to name",
    "trust": "covariance, quality",
    "turned": "joint, rotated",
    "vision": "landscape",
    "yardstick": "scale reference",
}
"""Words that stood for known things, each with the word to use."""

STEMS = PRIVATE.keys() | {"choices", "front", "parts", "turns", "words"}
"""Words that no file name may contain; ``pareto_front`` says which front."""

STANDARD = ("thin_plate", "pareto_front")
"""Names in which such a word is the standard one."""


def tracked(*patterns: str) -> list[Path]:
    listing = subprocess.run(
        ["git", "ls-files", "-z", *patterns],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if listing.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listing.stdout.split("\0") if name and (ROOT / name).exists()]


def words_of(name: str) -> set[str]:
    """The words of a name: ``ForwardSelection``, ``forward_selection``, ``SUBSETS``."""
    for standard in STANDARD:
        name = name.replace(standard, "")
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return {word.lower() for word in re.findall(r"[A-Za-z]+", spaced)}


def python_names(text: str) -> set[str]:
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {token.string for token in tokens if token.type == tokenize.NAME}


def rust_names(text: str) -> set[str]:
    """Of code alone: comments and texts may use any word."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    text = re.sub(r'"(?:\\.|[^"\\])*"', '""', text)
    return set(re.findall(r"[A-Za-z_]\w*", text))


def names_in(path: Path) -> set[str]:
    text = path.read_text(encoding="utf-8")
    return rust_names(text) if path.suffix == ".rs" else python_names(text)


def found(paths: list[Path]) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}: {name} (say {PRIVATE[word]})"
        for path in paths
        for name in sorted(names_in(path))
        for word in sorted(words_of(name) & PRIVATE.keys())
    ]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ForwardSelection", {"forward", "selection"}),
        ("_SETTLED", {"settled"}),
        ("RGBGains_of", {"rgb", "gains", "of"}),
        ("thin_plate", set()),
    ],
)
def test_names_are_split_into_words(name: str, words: set[str]) -> None:
    """The other tests pass on anything if this does not hold."""
    assert words_of(name) == words


def test_names_of_files_say_what_a_file_holds() -> None:
    """A reader finds the algorithm that she looks for in the list of files."""
    paths = tracked("crates", "python", "tests", "benches", "docs/*.md")
    paths = [path for path in paths if path != Path(__file__).resolve()]
    assert [str(p.relative_to(ROOT)) for p in paths if words_of(p.stem) & STEMS] == []


def test_names_in_the_package_are_those_of_the_field() -> None:
    """A reader who searches for the standard term finds the code."""
    assert found(tracked("python/*.py", "python/*.pyi")) == []


def test_names_in_the_core_are_those_of_the_field() -> None:
    """A Rust reader finds it, too."""
    assert found(tracked("crates/*.rs", "benches/*.rs")) == []


def test_names_in_the_benchmarks_are_those_of_the_field() -> None:
    """What is measured is called what the package calls it."""
    assert found(tracked("benches/*.py")) == []


def test_the_start_of_a_search_has_its_new_names() -> None:
    """``start="pyramid"`` and ``"table"`` are ``"neighbours"`` and ``"multistart"``."""
    old = re.compile(r"""start=["'](?:pyramid|table)["']""")
    paths = tracked("*.py", "*.md", "*.rs")
    paths = [path for path in paths if path != Path(__file__).resolve()]
    texts = ((path, path.read_text(encoding="utf-8")) for path in paths)
    assert [str(path.relative_to(ROOT)) for path, text in texts if old.search(text)] == []
