# Two commands on a fresh machine with Python 3.11+, make and git:
#   make run    environment, install, then the main job on an embedded default
#   make test   environment, install, everything
# `make check` is the quick half of `make test`: style, types, floors.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUT ?= out

.PHONY: run test check unit quiet beside guests long fuzz soak mutations wheel format golden schema clean

run: $(VENV)/.desk
	$(BIN)/dsz demo -o $(OUT)/demo

test: check unit quiet beside wheel

check: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/audit/audit.py

# The files that have a test of such a mark: to look for them in all that there are takes longer than some of them do.
marked = $(shell grep -rlE 'pytest\.mark\.$(1)\>' tests --include='test_*.py')

unit: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2 -m "not vcan and not long"

# A minute on a kernel's own vcan, beside nothing else: prints how late ticks were, for dsz and for a peer.
quiet: $(VENV)/.dev
	$(BIN)/python -m pytest -m quiet -s $(call marked,quiet)

# The fuzzers, in full, take a quarter of an hour of CPU. They get what is left of it (a session's own weight comes
# before a process's) by the guests, which want little but want it soon, by the mutations and by what takes long.
FUZZ ?=
beside: $(VENV)/.dev
	@mkdir -p $(OUT)
	setsid -w sh -c 'echo 10 2>/dev/null >/proc/self/autogroup; exec nice -n 10 "$$@"' fuzz \
		$(BIN)/python tests/fuzz/fuzz.py $(FUZZ) --out $(OUT)/fuzz >$(OUT)/fuzz.txt 2>&1 & fuzz=$$!; \
	trap 'kill $$fuzz 2>/dev/null' INT TERM; \
	$(MAKE) guests mutations long; others=$$?; \
	wait $$fuzz; fuzz=$$?; cat $(OUT)/fuzz.txt; \
	[ $$others -eq 0 ] && [ $$fuzz -eq 0 ]

# The fault table and a real systemd, one guest after the other.
guests: $(VENV)/.dev
	$(BIN)/python -m pytest -m "vcan and not quiet" -s $(call marked,vcan)

long: $(VENV)/.dev
	$(BIN)/python -m pytest -m long $(call marked,long)

# Alone, on two CPUs; the same as in `beside`.
fuzz: $(VENV)/.dev
	$(BIN)/python tests/fuzz/fuzz.py --out $(OUT)/fuzz

# A day of bus time as fast as it goes (some 30 min); not part of `make test`. The other soak: tests/soak/live_soak.py.
soak: $(VENV)/.dev
	$(BIN)/python tests/soak/soak.py --hours 24 --rate 20

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
