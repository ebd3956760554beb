# `make demo` and `make test` need git, make and Python 3.11 to 3.13; they set up the rest in .venv.

.PHONY: help demo docs test test-long test-kernel lint typecheck benchmark campaign \
    fault-campaign notebooks clean
# Or each process that a test starts would compile the sources anew.
export PYTHONDONTWRITEBYTECODE :=

.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

VENV := .venv
BIN := $(VENV)/bin
OUT ?= demo
JOBS ?= 2
DATA_OPTION := $(if $(WORKBENCH_DATA),--data "$(WORKBENCH_DATA)")
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
PINS := --constraint .ci/constraints.txt
SETUP := pyproject.toml .ci/constraints.txt

# The newest Python that the pins were made for; override with `make PYTHON=/path/to/python`.
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3 python; do \
    if $$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; \
    then echo $$p; break; fi; done)

help:
	@echo "make demo       run the demonstration and write its page to $(OUT)/"
	@echo "make test       lint, check types, run every test, doctest and notebook"
	@echo "make test-long  whole diagnoses, redesigns, the site, other tools; an hour or more"
	@echo "make test-kernel  what rests on linear algebra, with the instructions of an older processor"
	@echo "make docs       build the documentation site into build/site, with executed notebooks"
	@echo "make benchmark  measure speed beside other tools, page in build/benchmark, some minutes"
	@echo "make campaign   kill and starve the commands at random, minutes"
	@echo "make fault-campaign  every fault in every phase of a move with every controller, minutes"
	@echo "make notebooks  open the notebooks in Jupyter"
	@echo "make clean      remove the environment, caches and the demonstration's page"

demo: $(VENV)/installed
	$(BIN)/workbench demo --out "$(OUT)" $(DATA_OPTION)

# pytest comes last, so that its closing line is the last line.
test: lint typecheck
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal

# Whole diagnoses and redesigns, minutes each, the site, a cluster, other tools; and what rests on
# linear algebra under a second kernel.
test-long: $(VENV)/installed-test test-kernel
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal -m long

# What rests on linear algebra, again with the instructions of an old processor: no answer may turn
# on how a kernel rounds. Of designs for several outputs one test of each family will do.
KERNEL ?= Nehalem
NUMERIC := $(addprefix tests/,controllers/mpc controllers/plain controllers/joint \
    controllers/quadratic_program linearisation operating_point diagnosis/location/test_isolability.py)

test-kernel: $(VENV)/installed-test
	OPENBLAS_CORETYPE=$(KERNEL) $(BIN)/python -m pytest -q -n $(JOBS) --dist worksteal $(NUMERIC) \
	    -k "not test_several_outputs or each_output_follows"

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

typecheck: $(VENV)/installed-test
	$(BIN)/mypy

docs: $(VENV)/installed-docs
	WORKBENCH_EXECUTE_NOTEBOOKS=1 NO_MKDOCS_2_WARNING=1 \
	    $(BIN)/mkdocs build --config-file data/docs/mkdocs.yml
	@echo "Open build/site/index.html"

benchmark: $(VENV)/installed-benchmark
	$(BIN)/python -m workbench.speed --out build/benchmark

# Every fault of sensors, references, supply and deadline in every phase of a move, with every
# family, in Python and in C: minutes. Each family tells its runs and its time.
fault-campaign: $(VENV)/installed-test
	$(BIN)/python -m pytest -q -m long tests/controllers/test_fault_campaign.py

# Kills, full disks and missing compilers, minutes.
campaign: $(VENV)/installed-test
	$(BIN)/python -m pytest -m long tests/campaign

notebooks: $(VENV)/installed
	$(PIP) $(PINS) --editable ".[notebooks]"
	$(BIN)/jupyter lab notebooks

clean:
	rm -rf $(VENV) build *.egg-info .mypy_cache .pytest_cache .ruff_cache "$(OUT)"

$(BIN)/python:
	@test -n "$(PYTHON)" || { \
	    echo "No Python 3.11, 3.12 or 3.13 found; install one or run: make PYTHON=/path/to/python" >&2; \
	    exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || { \
	    echo "$(PYTHON) is not Python 3.11, 3.12 or 3.13; run: make PYTHON=/path/to/python" >&2; \
	    exit 1; }
	@"$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "$(PYTHON) lacks the module venv; install it (Debian, Ubuntu: apt install python3-venv)" >&2; \
	    exit 1; }
	"$(PYTHON)" -m venv --clear $(VENV)

$(VENV)/installed: $(SETUP) | $(BIN)/python
	$(PIP) $(PINS) --editable .
	@touch $@

$(VENV)/installed-benchmark: $(SETUP) | $(VENV)/installed
	$(PIP) $(PINS) --editable ".[benchmark]"
	@touch $@

$(VENV)/installed-docs: $(SETUP) | $(VENV)/installed
	$(PIP) $(PINS) --editable ".[docs]"
	@touch $@

# In one go, with what `installed` has; of its thousands of files a quarter is ever compiled.
$(VENV)/installed-test: $(SETUP) | $(BIN)/python
	$(PIP) $(PINS) --no-compile --editable ".[test]"
	@touch $(VENV)/installed $@
