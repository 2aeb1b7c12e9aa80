"""Licences of what impasto is built of and installed with: permissive ones, as ``deny.toml`` lists.

Advisories are not compared: they change from day to day (``CONTRIBUTING.md`` has the command).
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tomllib
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
PYTHON = {
    *("CC0-1.0", "MIT-CMU", "PSF-2.0", "BSD", "BSD-3-Clause License", "Apache 2.0"),
    *("Apache Software License", "BSD License", "MIT License", "BSD 3-Clause License"),
    "Python Software Foundation License",
}
"""Licences of Python packages beside those of crates, in the words of their authors."""
READ = {
    "openexr": "BSD-3-Clause",  # LICENSE.md of its source
}
"""Of packages whose metadata name none."""


@cache
def allowed() -> set[str]:
    return set(tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]["allow"])


def permitted(expression: str, known: set[str]) -> bool:
    """Whether an SPDX expression can be met by known licences: one of OR, all of AND."""
    words = re.findall(r"\(|\)|[^()\s]+", expression.replace("/", " OR "))
    terms: list[str] = []
    for word in words:
        if word in {"(", ")"}:
            terms.append(word)
        elif word in {"AND", "OR"}:
            terms.append(word.lower())
        elif word == "WITH" or (terms and terms[-1].endswith(" WITH")):
            terms[-1] = f"{terms[-1]} {word}"
        else:
            terms.append(word)
    python = (t if t in {"(", ")", "and", "or"} else str(t in known) for t in terms)
    return bool(eval(" ".join(python), {"__builtins__": {}}))


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("MIT", True),
        ("GPL-3.0-only", False),
        ("MIT OR GPL-3.0-only", True),
        ("MIT AND GPL-3.0-only", False),
        ("MIT/Apache-2.0", True),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", True),
        ("(MIT OR Apache-2.0) AND LGPL-2.1-or-later", False),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("GPL-2.0-only WITH Classpath-exception-2.0", False),
        ("Apache-2.0 WITH LLVM-exception OR GPL-2.0-only", True),
    ],
)
def test_an_expression_is_read_as_spdx_means_it(expression: str, expected: bool) -> None:
    assert permitted(expression, allowed()) is expected


def test_crates_have_permissive_licences() -> None:
    if shutil.which("cargo") is None:
        pytest.skip("cargo is not installed")
    words = ["cargo", "metadata", "--offline", "--locked", "--format-version", "1"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:  # crates of other systems may never have been fetched
        told = subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout
        host = next(line.split()[1] for line in told.splitlines() if line.startswith("host:"))
        words += ["--filter-platform", host]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    packages = json.loads(done.stdout)["packages"]
    assert len(packages) > 100
    wrong = {
        f"{one['name']} {one['version']}": one["license"]
        for one in packages
        if not permitted(one["license"] or "none", allowed())
    }
    assert wrong == {}
    # One registry, that of the language: its index has this name whatever host serves it.
    (registry,) = {one["source"] for one in packages} - {None}
    assert re.fullmatch(r"registry\+https://[^/]+/rust-lang/crates\.io-index", registry)


def needed(names: list[str], found: dict[str, Any]) -> dict[str, Any]:
    """The metadata of packages, and of all that they need in turn on this system."""
    for text in names:
        requirement = Requirement(text)
        name = requirement.name.lower().replace("_", "-")
        if name in found:
            continue
        chosen = requirement.extras or {""}
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            package = distribution(requirement.name)
        except PackageNotFoundError:
            continue  # an extra that is not installed here
        found[name] = package.metadata
        inner = [
            one.split(";")[0]
            for one in package.requires or []
            if (marker := Requirement(one).marker) is None
            or any(marker.evaluate({"extra": extra}) for extra in chosen)
        ]
        needed(inner, found)
    return found


def licence_of(name: str, metadata: Any) -> list[str]:
    """What a package says of its licence: the expression, else classifiers, else a short text."""
    if name in READ:
        return [READ[name]]
    if expression := metadata.get("License-Expression"):
        return [expression]
    named = [
        line.rpartition(" :: ")[2]
        for line in metadata.get_all("Classifier") or ()
        if line.startswith("License ::") and not line.endswith("OSI Approved")
    ]
    return named or [(metadata.get("License") or "none").splitlines()[0]]


def test_packages_that_are_installed_with_impasto_have_permissive_licences() -> None:
    """The package and its extras; peers, tests and documentation are for those who develop it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["plot"], *extras["video"], *extras["scale"]]
    found = needed(wanted, {})
    assert found.keys() >= {"numpy", "tifffile", "rich", "zarr", "distributed", "pillow"}
    known = allowed() | PYTHON
    wrong = {
        name: licences
        for name, metadata in found.items()
        for licences in [licence_of(name, metadata)]
        if not all(one in known or permitted(one, known) for one in licences)
    }
    assert wrong == {}
