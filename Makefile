# Everything from a fresh clone: `make` scores the shipped policies, `make test` passes the tests.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
OURS := $(VENV)/.made-by-swingup

.PHONY: leaderboard test slow lint types format examples docs check clean

leaderboard: $(READY)
	$(BIN)/swingup leaderboard

# Bytecode is kept, whatever the shell says: the tests start dozens of processes, and each would compile the sources.
test slow: export PYTHONDONTWRITEBYTECODE =

test: $(READY)
	$(BIN)/python -m pytest -n 2 --dist worksteal

slow: $(READY)  # compiled as users' programs are: the default suite's flags are for speed
	XLA_FLAGS= $(BIN)/python -m pytest -m slow -n 2 --dist worksteal

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

examples: $(READY)
	folder=$$(mktemp -d) && for example in $(CURDIR)/examples/[0-9]*.py; do \
		echo "$$example" && (cd "$$folder" && $(abspath $(BIN))/python "$$example") || exit 1; \
	done && rm -r "$$folder"

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

check: lint types test examples docs

# An environment that this file did not make is left alone: its owner may need its packages as they are.
$(READY): pyproject.toml
	@test ! -e $(VENV) || test -e $(OURS) || test -e $(READY) || { \
		echo "$(VENV) is there and was not made by this Makefile: choose another with make VENV=PATH" >&2; exit 2; }
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'swingup needs Python 3.11 or newer: make PYTHON=python3.12')"
	$(PYTHON) -m venv $(VENV)
	touch $(OURS)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $(READY)

clean:
	@test ! -e $(VENV) || test -e $(OURS) || test -e $(READY) || { \
		echo "$(VENV) was not made by this Makefile: remove it yourself" >&2; exit 2; }
	rm -rf $(VENV) build dist site src/*.egg-info .mypy_cache .pytest_cache .ruff_cache
