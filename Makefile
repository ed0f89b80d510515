# Two commands on a fresh machine with Python 3.11+, make and git:
#   make run    environment, install, then the main job on an embedded default
#   make test   environment, install, everything
# `make check` is the quick half of `make test`: style, types, floors.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUT ?= out

.PHONY: run test check unit long mutations wheel format golden schema clean

run: $(VENV)/.desk
	$(BIN)/dsz demo -o $(OUT)/demo

test: check unit mutations wheel

check: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

unit: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2 -m "not long"

# A real systemd, the fault table and the fuzzers: minutes each, one after the other, on a machine that is otherwise quiet.
long: $(VENV)/.dev
	$(BIN)/python -m pytest -m long

# Each sign, factor and term of the core is broken in turn; a test must notice.
mutations: $(VENV)/.dev
	$(BIN)/python tests/mutation/mutations.py

# The wheel and the sdist build, and dsz works from the wheel alone, in an empty folder.
wheel: $(VENV)/.dev
	$(BIN)/python tests/wheel/install_wheel.py

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# After a change of behaviour that is meant: write the golden replays anew and read their diff.
golden: $(VENV)/.dev
	$(BIN)/python tests/golden/golden.py

schema: $(VENV)/.dev
	$(BIN)/python -m dsz_daemon.config.schema

clean:
	rm -rf $(VENV) build dist $(OUT)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "dsz needs Python 3.11 or newer, not " + sys.version.split()[0] + "; try make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)

# What an installation needs is stamped, so that the second make is quick.
$(VENV)/.desk: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[desk]'
	@touch $@

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@ $(VENV)/.desk
