# make demo    run slave and master as two processes, then print the HIL table
# make test    run the tests that need no emulator, no benchmark and no second system
# make check   run everything, and tell at the end what failed: make test, emulators, User Mode Linux, boards,
#              random search, style and types
# make coverage  run the unit tests alone and tell which share of the lines they run
# make search  run the random tests with eight times as many examples, from SEED
# make lint    check style and types
# make mutants change the code in small ways, SAMPLE in each of four rooms, and see whether tests notice
# make constraints  renew the versions that CI installs
# make docs    build the documentation into site/index.html
# make clean   remove what these have made
# Each sets up what it needs in a virtual environment of its own: VENV=.venv. JOBS=N tests run at a time.

PYTHON ?= python3
VENV ?= .venv
PACKAGES = hil sim boards firmware_stub
SEED ?= 1
SAMPLE ?= 25
# A file of versions to install, as CI does; without one the newest are installed.
CONSTRAINTS ?=
NATIVE = sim/native hil/slave/native
BIN = $(VENV)/bin
# Parts of the check, one after the other: a test that fails beside others runs once more, alone (tools/check.py).
CHECK = $(BIN)/python -m tools.check $(JOBS:%=--jobs %) --seed $(SEED)

.PHONY: demo test check coverage search lint mutants constraints docs clean help
.DEFAULT_GOAL = demo

demo: $(VENV)/.run
	@$(BIN)/uuv-hil demo --view

help:
	@sed -n '/^# make/,/^$$/s/^# //p' $(firstword $(MAKEFILE_LIST))

test search lint: $(VENV)/.dev
	@$(CHECK) $@

check: $(VENV)/.dev
	@$(CHECK)

coverage: $(VENV)/.dev
	$(BIN)/python -m pytest -n $(or $(JOBS),auto) tests/unit $(PACKAGES:%=--cov=%) --cov-report=term:skip-covered --durations=0

mutants: $(VENV)/.dev
	$(BIN)/python -m tools.mutants --sample $(SAMPLE) --seed $(SEED)

constraints:
	{ sed 1q .ci/constraints.txt; uv pip compile pyproject.toml --extra dev --universal --python-version 3.10 \
	  --upgrade --no-annotate --no-header --quiet; } > .ci/constraints.new && mv .ci/constraints.new .ci/constraints.txt

docs: $(VENV)/.docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "open site/index.html"

# Bytecode is compiled at install, that of tests by pytest: the first run starts as fast as every run.
$(VENV)/.run: EXTRA = master,view
$(VENV)/.dev: EXTRA = dev
$(VENV)/.docs: EXTRA = docs
$(VENV)/.run $(VENV)/.dev $(VENV)/.docs: pyproject.toml hatch_build.py c_extensions.py $(wildcard $(NATIVE:%=%/*.[ch]) firmware_stub/src/*.c firmware_stub/include/*.h)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo "Python 3.10 or later is needed; name one with: make PYTHON=/path/to/python3.10"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) \
	  || { echo "no virtual environment: sudo apt install python3-venv"; rm -rf $(VENV); exit 1; }
	@echo "installing into $(VENV) (once)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check $(CONSTRAINTS:%=-c %) -e '.[$(EXTRA)]'
	@$(BIN)/python -m compileall -q $(PACKAGES)
	@test $(EXTRA) != dev || PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest --collect-only -qq tests/process tests/unit >/dev/null
	@touch $@

clean:
	rm -rf $(VENV) $(NATIVE:%=%/*.so) runs site .mypy_cache .ruff_cache .pytest_cache
