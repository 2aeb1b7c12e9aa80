# Everything a checkout needs. `make help` lists the targets; each sets up what it uses.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
RUST   := Cargo.toml $(wildcard Cargo.lock) $(shell find $(wildcard crates benches) -name '*.rs' -o -name '*.wgsl' -o -name Cargo.toml)

# The interpreter that cargo, maturin and pip see is the one in .venv; versions come from one file.
export VIRTUAL_ENV    := $(CURDIR)/$(VENV)
export PYO3_PYTHON    := $(CURDIR)/$(BIN)/python
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_QUIET := 1

# One process per core, each on one thread: two pools of threads on the same cores are slower.
PYTEST := IMPASTO_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -n auto --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help build demo test test-fast lint lint-rust lint-python test-rust test-core test-gpu test-python docs wheel sanitize bench study pictures clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

build: $(VENV)/built  ## create .venv with a release build of impasto in it

demo: $(VENV)/built  ## measure and relight a simulated painting; pictures in demo/
	$(BIN)/impasto demo --out demo

# The release build keeps one core busy for minutes: meanwhile the other does what needs no extension.
test: $(VENV)/created  ## run every check: lint, Rust, Python, documentation
	@$(MAKE) --no-print-directory --jobs 4 $(VENV)/compiled lint-rust lint-python test-core
	@$(MAKE) --no-print-directory --jobs 2 test-gpu docs
	@$(MAKE) --no-print-directory test-python

lint: lint-rust lint-python  ## check formats, clippy, ruff and mypy; warnings are errors

lint-rust: $(VENV)/created
	cargo fmt --all --check
	cargo clippy --quiet --workspace --all-targets -- -D warnings
	cargo clippy --quiet --package impasto --no-default-features --features lm --lib --example decay -- -D warnings
	cargo clippy --quiet --package impasto-py --no-default-features --features operations -- -D warnings

lint-python: $(VENV)/extras
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

test-rust: test-core test-gpu  ## run the Rust tests

test-core:
	cargo test --quiet
	cargo test --quiet --package impasto --no-default-features --features lm,operations --lib lanes::

# The renderer for graphics cards is tested as it is built for Python: what it needs is compiled once.
test-gpu: $(VENV)/built
	cargo test --quiet --release --package impasto-gpu --package impasto-py

test-python: $(VENV)/built $(VENV)/extras  ## run the Python tests, README and documentation examples
	$(PYTEST)

test-fast: $(VENV)/built $(VENV)/extras  ## run the fast Python tests: most of them, in a tenth of the time
	$(PYTEST) -m "not slow"

docs: $(VENV)/built $(VENV)/extras  ## build the documentation into docs/_build/html
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html
	@echo "docs: open docs/_build/html/index.html"

wheel: $(VENV)/built $(VENV)/release  ## build wheel and source archive into dist/; try each in an empty environment
	rm -rf dist
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/maturin build --release --zig --compatibility manylinux2014 --out dist
	$(BIN)/maturin sdist --out dist
	$(BIN)/auditwheel show dist/*.whl
	PYTHON=$(BIN)/python .ci/try_archive dist/*.whl
	PYTHON=$(BIN)/python .ci/try_archive dist/*.tar.gz

# The runtime library of the sanitizer is there for the target that is named, and the standard library needs none.
sanitize:  ## run the tests of the vector code with AddressSanitizer; builds for many minutes
	RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address cargo test --quiet --target-dir target/sanitize \
	  --target $$(rustc -vV | sed -n 's/^host: //p') --package impasto --lib lanes

bench: $(VENV)/built $(VENV)/extras $(VENV)/peers  ## time the numerics against peers; ratios go to benches/results
	cargo bench --package impasto-benches --bench numerics
	$(BIN)/python benches/python/fits.py --record
	$(BIN)/python benches/python/lobes.py --record
	$(BIN)/python -m pytest benches/python -q --record

study: $(VENV)/built $(VENV)/extras $(VENV)/peers  ## measure anew all that docs/accuracy-and-time.md shows
	$(BIN)/python benches/study --record
	$(BIN)/python benches/python/kernels.py --record
	$(BIN)/python benches/python/fits.py --record
	$(BIN)/python benches/python/training_spectra.py --write
	$(BIN)/python benches/python/suggestions.py --record
	$(BIN)/python benches/study --redraw
	$(BIN)/python benches/python/pages.py

pictures: $(VENV)/built  ## make the pictures of README and documentation again
	$(BIN)/python docs/pictures.py

clean:  ## remove .venv and everything built
	rm -rf $(VENV) target demo dist docs/_build docs/_generated python/impasto/*.so
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/created:
	@command -v cargo >/dev/null || { echo "impasto needs Rust: install rustup, then run make again" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "impasto needs Python 3.11 or newer: run make PYTHON=python3.x" >&2; exit 1; }
	@echo "make: fetching tools into $(VENV)"
	@$(PYTHON) -m venv $(VENV) \
	  || { echo "no venv here: on Debian, apt-get install python3-venv" >&2; exit 1; }
	@$(BIN)/python -m pip install --upgrade pip maturin
	@touch $@

# The editable install: Python edits are live, only Rust edits build again.
$(VENV)/built: $(VENV)/compiled pyproject.toml constraints.txt
	@$(BIN)/maturin develop --release --quiet
	@touch $@

# Without pip, which may be fetching the extras at the same time.
$(VENV)/compiled: $(VENV)/created $(RUST)
	@echo "make: building impasto; the first time takes a few minutes"
	@$(BIN)/maturin develop --release --quiet --skip-install
	@touch $@

# Fitters to compare with; the benchmark names those that are missing.
$(VENV)/peers: pyproject.toml | $(VENV)/built
	@echo "make: fetching fitters to compare with"
	@$(BIN)/python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]; print("\n".join(p["peers"]))' > $(VENV)/peers.txt
	@$(BIN)/python -m pip install --requirement $(VENV)/peers.txt || echo "make: going on without them"
	@touch $@

# A compiler and a C library that are the same everywhere: the wheel runs on Linux since glibc 2.17.
$(VENV)/release: pyproject.toml constraints.txt | $(VENV)/built
	@$(BIN)/python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]; print("\n".join(p["release"]))' > $(VENV)/release.txt
	@$(BIN)/python -m pip install --requirement $(VENV)/release.txt
	@touch $@

# What impasto itself needs, too: types are checked before it is installed.
$(VENV)/extras: pyproject.toml constraints.txt | $(VENV)/created
	@echo "make: fetching what tests and documentation need"
	@$(BIN)/python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; more = p["optional-dependencies"]; print("\n".join(p["dependencies"] + more["test"] + more["docs"]))' > $(VENV)/extras.txt
	@$(BIN)/python -m pip install --requirement $(VENV)/extras.txt
	@touch $@
