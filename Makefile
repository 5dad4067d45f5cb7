# make demo [PHOTO=photo.jpg]   reconstruct a photo and say where the results are
# make test                     lint, types and the whole test suite
# make kernels                  the tests that rounding could upset, with other kernels of the libraries
# make lint | clean             the first part alone | remove what make made
# PYTHON=python3.12 chooses the interpreter that .venv is made with.

PYTHON ?= python3
PHOTO ?= examples/basketball.png
VENV := .venv
BIN := $(VENV)/bin
DISTRIBUTIONS := pyproject.toml $(wildcard plugins/*/pyproject.toml)

# Values with blanks and quotes reach the shell as they are.
export PHOTO
.PHONY: demo test kernels lint clean

demo: $(VENV)/demo.stamp
	@name=$$(basename "$$PHOTO"); $(BIN)/physic run "$$PHOTO" -o "demo/$${name%.*}"

# One thread for the small fits of the tests: two are slower wherever something else runs.
test: lint
	OMP_NUM_THREADS=1 $(BIN)/pytest tests plugins

# Nehalem's kernels run on every x86-64 and are no newer machine's default; elsewhere OpenBLAS knows no such name and keeps
# its own. MKL_CBWR changes the products of torch, which the other two variables leave alone.
kernels: $(VENV)/test.stamp
	OPENBLAS_CORETYPE=Nehalem ATEN_CPU_CAPABILITY=default MKL_CBWR=COMPATIBLE OMP_NUM_THREADS=2 \
		$(BIN)/pytest -m kernels tests plugins

lint: $(VENV)/test.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	$(BIN)/mypy

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version.split()[0]; sys.version_info >= (3, 11) or sys.exit("PhySIC needs Python 3.11 or newer, $(PYTHON) is " + v + ": make PYTHON=python3.12 ...")'
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "$(PYTHON) has no venv module: apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/demo.stamp: requirements.txt constraints.txt $(DISTRIBUTIONS) | $(BIN)/python
	$(BIN)/python -m pip install --disable-pip-version-check -r requirements.txt
	@touch $@

$(VENV)/test.stamp: requirements-dev.txt requirements.txt constraints.txt $(DISTRIBUTIONS) | $(BIN)/python
	$(BIN)/python -m pip install --disable-pip-version-check -r requirements-dev.txt
	@touch $(VENV)/demo.stamp $@

clean:
	rm -rf $(VENV) demo
