# Everything from a fresh clone: `make` trains a policy and shows it, `make test` passes the tests.
# `make ROBOT=pendubot` takes the other robot, `make FRAMES=100000` trains for fewer frames.
ROBOT = acrobot
FRAMES =
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
OURS := $(VENV)/.made-by-swingup
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .[dev]
ANOTHER_PYTHON := make PYTHON=python3.12

.PHONY: demo leaderboard test slow lint types format examples docs check clean

demo: $(READY)
	@$(BIN)/swingup demo $(ROBOT) $(if $(FRAMES),--frames $(FRAMES))

leaderboard: $(READY)
	$(BIN)/swingup leaderboard

# Bytecode is kept, whatever the shell says: the tests start dozens of processes, and each would compile the sources.
test slow: export PYTHONDONTWRITEBYTECODE =

test: $(READY)
	$(BIN)/python -m pytest -n 2 --dist worksteal

# Compiled as users' programs are: the default suite's flags are for speed. The tests left out need other environments.
slow: $(READY)
	XLA_FLAGS= $(BIN)/python -m pytest -m slow -n 2 --dist worksteal -k "not gymnax_itself and not of_the_package"

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
	@command -v $(PYTHON) >/dev/null || { echo "make: there is no $(PYTHON): $(ANOTHER_PYTHON)" >&2; exit 2; }
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'make: swingup needs Python 3.11 or newer: $(ANOTHER_PYTHON)')"
	@mkdir -p $(VENV) && touch $(OURS)
	@echo "installing swingup and its tools in $(VENV): some minutes, once"
	@$(PYTHON) -m venv $(VENV) || { echo "make: '$(PYTHON) -m venv $(VENV)' failed:" \
		"install venv (Debian: python3-venv); or make clean, then $(ANOTHER_PYTHON)" >&2; exit 2; }
	@$(INSTALL) || { echo "make: '$(INSTALL)' failed, so that $(VENV) is not ready; repeat make" \
		"with a network; behind a proxy: HTTPS_PROXY=URL make; from a mirror: PIP_INDEX_URL=URL make;" \
		"offline: PIP_NO_INDEX=1 PIP_FIND_LINKS=FOLDER make; where a package lacks this Python:" \
		"make clean, then $(ANOTHER_PYTHON)" >&2; exit 2; }
	@touch $(READY)

clean:
	@test ! -e $(VENV) || test -e $(OURS) || test -e $(READY) || { \
		echo "$(VENV) was not made by this Makefile: remove it yourself" >&2; exit 2; }
	rm -rf $(VENV) build dist site src/*.egg-info .mypy_cache .pytest_cache .ruff_cache
