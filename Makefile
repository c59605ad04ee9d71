# make demo    the main job: slave and master as two processes, then the HIL table
# make test    the tests
# make lint    style and types
# Each sets up what it needs in a virtual environment of its own.

PYTHON ?= python3
VENV ?= .venv
PACKAGES = hil sim boards firmware_stub
NATIVE = sim/native hil/slave/native
BIN = $(VENV)/bin

.PHONY: demo test lint clean
.DEFAULT_GOAL = demo

demo: $(VENV)/.run
	@$(BIN)/uuv-hil demo

test: $(VENV)/.dev
	$(BIN)/python -m pytest

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Bytecode is compiled at install: the start-up time of the first run is that of every run.
$(VENV)/.run: EXTRA = master
$(VENV)/.dev: EXTRA = dev
$(VENV)/.run $(VENV)/.dev: pyproject.toml hatch_build.py $(wildcard $(NATIVE:%=%/*.[ch]) firmware_stub/src/*.c firmware_stub/include/*.h)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or later is needed; name one with: make PYTHON=/path/to/python3.11"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) \
	  || { echo "no virtual environment: sudo apt install python3-venv"; rm -rf $(VENV); exit 1; }
	@echo "installing into $(VENV) (once)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[$(EXTRA)]'
	@$(BIN)/python -m compileall -q $(PACKAGES)
	@touch $@

clean:
	rm -rf $(VENV) $(NATIVE:%=%/*.so) runs .mypy_cache .ruff_cache .pytest_cache
