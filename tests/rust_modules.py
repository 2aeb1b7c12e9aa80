"""Which Rust file imports from which: the module graph of a crate, read from its source."""

from __future__ import annotations

import re
from pathlib import Path

Module = tuple[str, ...]
"""A path inside the crate: ``()`` is ``lib.rs``, ``("a", "b")`` is ``a/b.rs`` or ``a/b/mod.rs``."""

_USE = r"\b(?:pub(?:\([^)]*\))?\s+)?use\s+([^;]+);"
_TESTS = r"#\[cfg\(test\)\]\s*(?:pub(?:\([^)]*\))?\s+)?mod "


def code(path: Path) -> str:
    """A Rust file without its comments and without its own tests."""
    text = re.sub(r"//.*", "", path.read_text(encoding="utf-8"))
    return re.split(_TESTS, text, maxsplit=1)[0]


def modules(crate: Path) -> dict[Module, Path]:
    """The modules of a crate's ``src`` folder and their files."""
    found = {}
    for path in sorted(crate.rglob("*.rs")):
        parts = path.relative_to(crate).with_suffix("").parts
        found[parts[:-1] if parts[-1] in {"mod", "lib"} else parts] = path
    return found


def _paths(tree: str) -> list[Module]:
    """The paths of a ``use`` tree: ``a::{b, c::d}`` is ``a::b`` and ``a::c::d``."""
    head, brace, rest = tree.partition("{")
    if not brace:
        return [tuple(re.split(r"\s*::\s*", tree.split(" as ")[0].strip()))]
    prefix = tuple(part for part in re.split(r"\s*::\s*", head.strip()) if part)
    inner, depth, start, found = rest.rpartition("}")[0] + ",", 0, 0, []
    for place, character in enumerate(inner):
        depth += (character == "{") - (character == "}")
        if character == "," and depth == 0:
            if part := inner[start:place].strip():
                found += [prefix + path for path in _paths(part)]
            start = place + 1
    return found


def _absolute(module: Module, path: Module, known: dict[Module, Path]) -> Module | None:
    """A path as the crate's root sees it; ``None`` where it leads to another crate."""
    first, *rest = path
    if first == "crate":
        return tuple(rest)
    if first == "self":
        return module + tuple(rest)
    if first == "super":
        module = module[:-1]
        while rest and rest[0] == "super":
            module, rest = module[:-1], rest[1:]
        return module + tuple(rest)
    return module + path if (*module, first) in known else None


def imports(crate: Path) -> dict[Module, set[Module]]:
    """The modules whose items each module names, a re-exported item's being its definition's."""
    known = modules(crate)
    texts = {module: code(path) for module, path in known.items()}
    used: dict[Module, list[Module]] = {}
    named: dict[Module, list[Module]] = {}
    for module, text in texts.items():
        trees = [path for tree in re.findall(_USE, text) for path in _paths(tree)]
        inline = re.findall(r"(?<![\w:])[a-z]\w*(?:::\w+)+", re.sub(_USE, "", text))
        absolute = [
            [full for path in paths if (full := _absolute(module, path, known)) is not None]
            for paths in (trees, [tuple(path.split("::")) for path in inline])
        ]
        used[module], named[module] = absolute[0], absolute[0] + absolute[1]
    doors = {
        module: {full[-1]: full for full in paths if full[: len(module)] == module}
        for module, paths in used.items()
    }

    def home(full: Module) -> Module:
        depth = max(length for length in range(len(full) + 1) if full[:length] in known)
        module = full[:depth]
        door = doors[module].get(full[depth]) if depth < len(full) else None
        if door is not None and door != full and door[: depth + 1] in known:
            return home(door + full[depth + 1 :])
        return module

    return {module: {home(full) for full in paths} - {module} for module, paths in named.items()}


def circles(graph: dict[Module, set[Module]]) -> list[list[str]]:
    """Groups of modules that import from each other, directly or by way of others."""
    reach: dict[Module, set[Module]] = {}
    for start in graph:
        seen: set[Module] = set()
        open_ = list(graph[start])
        while open_:
            if (module := open_.pop()) not in seen:
                seen.add(module)
                open_ += graph.get(module, ())
        reach[start] = seen
    groups = {
        frozenset(m for m in reach[start] if start in reach.get(m, set()))
        for start in graph
        if start in reach[start]
    }
    return sorted(sorted("::".join(m) or "lib" for m in group) for group in groups)
