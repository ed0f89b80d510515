# make run: environment, install, then the main job on an embedded default.
# make test: environment, install, everything. `make check` is the quick half of it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test check format golden clean
