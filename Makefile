# Every target sets up what it needs in $(VENV), on a machine that has only Python >= 3.11 with pip, and make.
# Another Python: make PYTHON=/path/to/python ...     Another environment: make VENV=.venv-second ...

VENV ?= .venv
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3 python; do \
	if $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then echo $$p; break; fi; done)
BIN := $(VENV)/bin
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check
CASE := clamped_beam
MARKS ?= not science and not docs and not whole
SECONDS ?= 60

# The linear algebra is small: more BLAS threads only get in each other's way, and in xdist's.
export OPENBLAS_NUM_THREADS = 1
export OMP_NUM_THREADS = 1
# The tests start many processes: what Python compiles is to be kept for the next.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:  # two pip runs in one environment break it
.PHONY: help report test lint docs bench numbers pages fuzz mutants same science clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-8s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

report: $(VENV)/.stamp-run  ## run configs/clamped_beam.toml and write reports/clamped_beam/
	$(BIN)/jointbayes run configs/$(CASE).toml
	@echo "Written:"
	@find reports/$(CASE) -type f | LC_ALL=C sort | sed 's/^/  /'

test: $(VENV)/.stamp-test  ## run the tests but those marked science, docs or whole; MARKS= runs them all
	$(BIN)/python -m tests.compile_loops
	$(BIN)/python -m pytest -n auto --dist worksteal -m "$(MARKS)" $(PYTEST_ARGS)

same: $(VENV)/.stamp-test  ## run every case briefly, say what differs from what tests/same/kept holds; ARGS=--update keeps it
	$(BIN)/python -m tests.same $(ARGS)

lint: $(VENV)/.stamp-lint  ## ruff check, ruff format --check, mypy, lint-imports: who imports whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.stamp-docs  ## build the documentation into site/, warnings are errors
	$(BIN)/mkdocs build --strict

bench: $(VENV)/.stamp-bench  ## time the likelihood and the samplers against others (less than five minutes)
	$(BIN)/python -m benchmarks.likelihood
	$(BIN)/python -m benchmarks.samplers

pages: $(VENV)/.stamp-test  ## write what README and docs quote of files and past runs, their figures, pages made from the code
	$(BIN)/python -m benchmarks.numbers --write-only

numbers: $(VENV)/.stamp-test  ## run every shipped case and write what README and docs quote of them (minutes)
	$(BIN)/python -m benchmarks.numbers
	$(BIN)/python -m benchmarks.walk_through

fuzz: $(VENV)/.stamp-test  ## damaged input for every reader, SECONDS=60 each; what fails is kept in fuzz-offenders/
	$(BIN)/python -m tests.fuzz all --seconds $(SECONDS)

mutants: $(VENV)/.stamp-test  ## single wrong lines put into a copy of the tree one at a time: each must fail a test; minutes
	$(BIN)/python -m tests.mutants $(MUTANTS)

science: $(VENV)/.stamp-test $(VENV)/.stamp-bench  ## the tests marked science, then the long studies against known truths: hours
	$(BIN)/python -m pytest -n auto --dist worksteal -m "science or long"
	$(BIN)/python -m benchmarks.likelihood --growth
	$(BIN)/python -m benchmarks.samplers --nuts
	$(BIN)/python -m benchmarks.random_frames
	$(BIN)/python -m benchmarks.exact_study
	$(BIN)/python -m benchmarks.interval_ends
	$(BIN)/python -m tests.science.calibration joint
	$(BIN)/python -m tests.science.calibration nuisances
	$(BIN)/python -m tests.science.calibration "noise scale"
	$(BIN)/python -m tests.science.calibration "ten kinds" --count 20
	$(BIN)/python -m benchmarks.limits_hold
	$(BIN)/python -m benchmarks.free_bar
	$(BIN)/python -m benchmarks.solid
	$(BIN)/python -m benchmarks.predictions
	$(BIN)/python -m benchmarks.false_alarms
	$(BIN)/python -m benchmarks.wrong_model
	$(BIN)/python -m benchmarks.modal_fit
	$(BIN)/python -m benchmarks.joint_damping
	$(BIN)/python -m benchmarks.measured_body
	$(BIN)/python -m tests.fuzz posterior --count 10000 --seed 2
	$(BIN)/python -m tests.fuzz all --together 3600
	JOINTBAYES_EXAMPLES=5000 $(BIN)/python -m pytest tests/test_public_domain.py

clean:  ## remove environments, caches and builds; reports/ stays
	rm -rf .venv .venv-* site dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests benchmarks -type d -name __pycache__ -exec rm -rf {} +

# One stamp for each set of dependencies, so that a report does not install test tools.
$(VENV)/.stamp-run: pyproject.toml | $(BIN)/python
	@echo "Installing jointbayes into $(VENV) ..."
	$(PIP) --editable .
	@touch $@

$(VENV)/.stamp-%: pyproject.toml | $(BIN)/python
	@echo "Installing jointbayes with the extra '$*' into $(VENV) ..."
	$(PIP) --editable '.[$*]'
	@touch $@ $(VENV)/.stamp-run

$(BIN)/python:
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "make: no Python >= 3.11 found (PYTHON='$(PYTHON)'); install one, or name it: make PYTHON=/path/to/python" >&2; exit 1; }
	@"$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "make: $(PYTHON) has no ensurepip, so no environment can be made; on Debian or Ubuntu: apt-get install python3-venv" >&2; exit 1; }
	"$(PYTHON)" -m venv $(VENV)
