# make demo [PHOTO=photo.jpg]   reconstruct a photo and say where its page is, to open in a browser
# make quick [JOBS=2]           the tests that matter while you work, in about a minute on two cores
# make test [JOBS=2]            lint, types and the tests
# make test-all [JOBS=2]        with the slow ones: every installed backend, photo, set of kernels and moment of several photos
# make photos [JOBS=2]          the slow tests of the examples' photos and of every installed backend
# make coverage [JOBS=2]        which lines and branches the tests do not run
# make test-ray                the tests of contrib/ray, with a cluster on this machine
# make kernels                  the tests that rounding could upset, with other kernels of the libraries
# make mutants                  remove each stated defense in turn, and require that its test fails (tools/attacks/mutants)
# make test-lowest | test-newest the tests of make quick, with the lowest and the newest versions of all dependencies
# make audit                    known vulnerabilities of the pinned dependencies; needs a network
# make findings                 run each script of findings/: a table of what changed in other tools; needs a network
# make release                  one archive that installs PhySIC, in dist: wheels, tested versions, bill of materials, licenses
# make check-release            make it, check its wheels (twine, check-wheel-contents), and the workflows of CI (zizmor)
# make sbom                     a bill of materials of this environment, in dist/physic-sbom.json (CycloneDX)
# make docs                     the documentation as a site, in docs/_build/html/index.html; compares its notebooks with results
# make pictures                 pictures, their numbers and notebooks of the documentation, made again; needs Chromium
# make lint | clean             ruff, import contracts, mypy and the prose linter | remove what make made
# PYTHON=python3.12 chooses the interpreter that .venv is made with.

PYTHON ?= python3
PHOTO ?= examples/couple.jpg
JOBS ?= 2
VENV := .venv
BIN := $(VENV)/bin
TOOLS := .venv-tools
DISTRIBUTIONS := pyproject.toml $(wildcard contrib/*/pyproject.toml plugins/*/pyproject.toml)

# Values with blanks and quotes reach the shell as they are.
export PHOTO
.PHONY: demo quick test test-all photos coverage test-ray kernels mutants test-lowest test-newest audit release check-release sbom docs site notebooks pictures findings lint clean

demo: $(VENV)/demo.stamp
	@name=$$(basename "$$PHOTO"); $(BIN)/physic run "$$PHOTO" -o "demo/$${name%.*}"

# One process a core and one thread a process: the fits of the tests are too small to share. A file stays in one process,
# with the worlds that its tests share. conftest.py chooses the order: the files with slow tests first.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/pytest -q -n $(JOBS) --dist loadfile --no-loadscope-reorder

# Marked by facts per second: a quarter of all tests, runs of the pipeline among them.
QUICK = $$(grep -rl --include='test_*.py' 'mark\.quick' tests plugins) -m "quick and not slow"

quick: $(VENV)/test.stamp
	$(PYTEST) $(QUICK)

TESTS := tests plugins contrib/ray/tests/test_resources.py

test: lint
	$(PYTEST) $(TESTS) -m "not slow"

test-all: lint
	$(PYTEST) $(TESTS)

photos: $(VENV)/test.stamp
	$(PYTEST) -m slow tests/pipeline/test_examples.py plugins/testing/tests/testing/conformance/test_installed.py

# With the processes that tests start; the slow ones add time and hardly a line.
coverage: $(VENV)/test.stamp
	$(BIN)/coverage erase
	OMP_NUM_THREADS=1 $(BIN)/coverage run -m pytest -q -n $(JOBS) --dist loadfile $(TESTS) -m "not slow"
	$(BIN)/coverage combine -q
	$(BIN)/coverage report

# One process: its cluster takes both cores.
test-ray: $(VENV)/test.stamp
	OMP_NUM_THREADS=1 $(BIN)/pytest -q contrib/ray

# Nehalem's kernels run on every x86-64 and are no newer machine's default; elsewhere OpenBLAS knows no such name and keeps
# its own. MKL_CBWR changes the products of torch, which the other two variables leave alone. Threads that wait passively
# leave the cores to those of the other process.
kernels: $(VENV)/test.stamp
	OPENBLAS_CORETYPE=Nehalem ATEN_CPU_CAPABILITY=default MKL_CBWR=COMPATIBLE OMP_NUM_THREADS=2 OMP_WAIT_POLICY=PASSIVE \
		$(BIN)/pytest -q -n $(JOBS) --dist loadfile -m kernels $$(grep -rl --include='test_*.py' 'mark\.kernels' tests plugins)

mutants: $(VENV)/test.stamp
	$(BIN)/python tools/mutants.py

# An environment of its own, without constraints.txt. Only the dependencies of the distributions themselves are the lowest:
# what these require is the newest. Modules are compiled at once, as some old versions warn then, and warnings fail tests.
test-lowest: RESOLUTION := lowest-direct
test-newest: RESOLUTION := highest
test-lowest test-newest: $(VENV)/test.stamp
	$(BIN)/uv venv --quiet --clear --python $(BIN)/python .venv-$(RESOLUTION)
	grep -v '^-c' requirements-dev.txt | $(BIN)/uv pip install --python .venv-$(RESOLUTION)/bin/python \
		--compile-bytecode --resolution $(RESOLUTION) -r -
	OMP_NUM_THREADS=1 .venv-$(RESOLUTION)/bin/python -m pytest -q -n $(JOBS) --dist loadfile $(QUICK)

audit: $(TOOLS)/stamp
	$(TOOLS)/bin/pip-audit --strict --no-deps --disable-pip -r constraints.txt

findings:
	@$(PYTHON) findings/table.py

release: $(VENV)/test.stamp
	$(BIN)/python tools/release.py dist

# As an index would receive them. W002: a licence lies beside the networks, too. W009: a distribution has several packages,
# which the tests compare.
check-release: release $(TOOLS)/stamp
	rm -rf dist/physic && $(BIN)/python -m zipfile -e dist/physic-*.zip dist/physic
	$(TOOLS)/bin/twine check --strict dist/physic/wheels/*
	$(TOOLS)/bin/check-wheel-contents --ignore W002,W009 dist/physic/wheels
	$(TOOLS)/bin/zizmor --offline .github

sbom: $(VENV)/test.stamp
	$(BIN)/python tools/sbom.py dist/physic-sbom.json

docs: site notebooks

# Without a network: warnings are errors, a link to nothing within the site among them.
site: $(VENV)/test.stamp
	$(BIN)/python -m sphinx -W --keep-going -q -c docs/site -d docs/_build/doctrees . docs/_build/html

notebooks: $(VENV)/test.stamp
	$(BIN)/python tools/run_notebooks.py --check

pictures: $(VENV)/test.stamp
	$(BIN)/python tools/docs_pictures.py

lint: $(VENV)/test.stamp $(TOOLS)/stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	$(BIN)/mypy
	$(TOOLS)/bin/python tools/prose.py

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version.split()[0]; sys.version_info >= (3, 11) or sys.exit("PhySIC needs Python 3.11 or newer, $(PYTHON) is " + v + ": make PYTHON=python3.12 ...")'
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "$(PYTHON) has no venv module: apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# The build backend is installed once and builds every distribution: an environment for each costs a second of CPU time.
# uv takes less than half of pip's time, and reads none of its settings: where it reaches no index, pip may.
PIP := $(BIN)/python -m pip install --disable-pip-version-check
UV := UV_FIND_LINKS="$$PIP_FIND_LINKS" $(BIN)/uv pip install --python $(BIN)/python

# The first run keeps the networks as onnxruntime optimises them for this processor.
$(VENV)/demo.stamp: requirements.txt constraints.txt $(DISTRIBUTIONS) | $(BIN)/python
	$(PIP) --quiet -c constraints.txt uv hatchling editables
	$(UV) --no-build-isolation -r requirements.txt || $(PIP) --no-build-isolation -r requirements.txt
	@touch $@

# Modules are compiled at once, those of the project too: where Python may write none, each process of a test would compile
# them again.
$(VENV)/test.stamp: requirements-dev.txt requirements.txt constraints.txt $(DISTRIBUTIONS) | $(BIN)/python
	$(PIP) --quiet -c constraints.txt uv hatchling editables
	$(UV) --no-build-isolation --compile-bytecode -r requirements-dev.txt || $(PIP) --no-build-isolation -r requirements-dev.txt
	$(BIN)/python -m compileall -q physic_core $(wildcard plugins/*/physic_*)
	@touch $(VENV)/demo.stamp $@

# Apart from the project, whose pinned versions they do not all accept.
$(TOOLS)/stamp: requirements-tools.txt
	$(PYTHON) -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip install --disable-pip-version-check --quiet -r requirements-tools.txt
	@touch $@

clean:
	rm -rf $(VENV) $(TOOLS) .venv-lowest-direct .venv-highest demo dist docs/_build docs/_reference
