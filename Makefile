# `make alice` grades the sample submission, `make test` runs the tests that a person runs before a commit.
# Each makes the virtual environment that it needs. Besides bubblewrap, a compiler and, for tests of pages,
# Chromium, nothing is installed into the system, and these only as root.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEV_STAMP := $(VENV)/.installed-dev
# Parts of the package for Lab 09-01, the review desk and students' programs.
EXTRAS := desk,mujoco,scipy
# uv installs in a tenth of pip's CPU time, and keeps its packages in a cache. It knows no settings of pip, such as a mirror or a folder
# of wheels: if it finds no package, pip installs. `-qq` shows errors alone: with several package indexes, pip writes a warning
# for each package that one of them lacks.
UV_INSTALL = $(BIN)/uv pip install -q --python $(BIN)/python -c constraints.txt
PIP_INSTALL = $(BIN)/python -m pip install -qq --no-compile --disable-pip-version-check -c constraints.txt
INSTALL = { $(UV_INSTALL) $(1) 2>/dev/null || $(PIP_INSTALL) $(1) || $(NOT_INSTALLED); }
# Students' programs import compiled modules, since they cannot write in the environment. Two thirds of the code are tests or tools.
COMPILE = $(BIN)/python -m compileall -qq -j 0 -x '/(tests?|testing|_pytest|docutils|pip|pygments|setuptools)/' $(VENV)/lib
NOT_INSTALLED = { echo "The packages could not be installed, see above; the first time, this needs a network."; exit 1; }

# Compiled test modules are kept: each worker needs them, and rewriting the assertions costs a core 12 s.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: alice test thorough fixtures attacks course-ros bench docs package sbom audit system system-dev lint types layers house clean test-all test-rest

alice: $(STAMP) system
	$(BIN)/grade submissions/alice/

# Tests of `make test`: pure ones without the slow properties, and a live smoke test. `make test-rest` runs the others.
QUICK := ((not live and not browser and not slow) or smoke)
# Durations of all tests in the form of JUnit.
DURATIONS := build/tests

# mypy needs a core for a minute: it runs behind the tests, and its output follows theirs.
test: $(DEV_STAMP) system-dev lint
	@said=$$(mktemp); nice $(MAKE) --no-print-directory -k types layers house >"$$said" 2>&1 & checks=$$!; \
	  $(BIN)/python -m pytest -n 2 -m "$(QUICK)" --junitxml=$(DURATIONS)/quick.xml; tests=$$?; \
	  wait $$checks; checked=$$?; cat "$$said"; rm -f "$$said"; exit $$((tests | checked))

# Live tests, the browser, the slow properties, and a rotating part of the fixtures, attacks and limits; some thirty minutes.
test-rest: $(DEV_STAMP) system-dev
	$(BIN)/python -m pytest -n 3 -m "not $(QUICK)" --junitxml=$(DURATIONS)/rest.xml

test-all: test test-rest

# All examples and cases of which each run tries a part, others for each commit; some five minutes.
thorough: $(DEV_STAMP) system-dev
	THOROUGH=1 $(BIN)/python -m pytest -n 4 -m "not live"

# Every fixture and every submission of a lab. `make test-all` grades some of them, others for each commit.
fixtures: $(DEV_STAMP) system
	FIXTURES=all $(BIN)/python -m pytest -n 3 tests/live/test_fixtures.py tests/live/test_labs.py tests/live/test_goal_lab.py \
	  tests/live/test_own_interfaces.py

# Every attack of fixtures/attacks in all three environments, every launch file that misbehaves, every low limit, and whatever
# else may be killed or take too much; more than an hour. `make test-all` tries a part of them.
attacks: $(DEV_STAMP) system
	ATTACKS=all $(BIN)/python -m pytest -n 3 tests/live/test_attacks.py tests/live/test_launch_containment.py \
	  tests/live/test_limits.py tests/live/sandbox/test_isolation.py tests/live/session/test_runner.py \
	  tests/classroom/test_class.py tests/classroom/test_worker.py

# The solution on each installation of ROS that wheels can imitate: Jazzy with NumPy 1.26, with and without the real launch,
# and Kilted; some three minutes. `make test-all` tries one of the first two.
course-ros: $(DEV_STAMP) system
	THOROUGH=1 $(BIN)/python -m pytest tests/live/test_course_ros.py

# What grading costs and how sure it is, on this machine; some twenty minutes. Run it while nothing else runs.
bench: $(STAMP) system
	$(BIN)/python -m bench.stability
	$(BIN)/python -m bench

# The documentation as a site; a link that leads nowhere ends it. Open site/index.html.
docs: $(DEV_STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# Wheel and source archive in dist/. Two builds must have the same bytes.
package: $(DEV_STAMP)
	rm -rf dist build/again
	@for folder in dist build/again; do \
	  SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(BIN)/python -m hatchling build -d $$folder -t wheel -t sdist || exit 1; done
	diff -r dist build/again
	$(BIN)/twine check --strict dist/*
	$(BIN)/check-wheel-contents dist/*.whl

# Both tools need `lark`, which `lark-parser` of ROS would overwrite here; so each has an environment of its own in uv's cache.
SBOM := $(BIN)/uv tool run --quiet --from cyclonedx-bom==7.5.0 cyclonedx-py
AUDIT := $(BIN)/uv tool run --quiet pip-audit==2.10.1

# Bill of materials of the images' Python packages: build/sbom.json, in the form of CycloneDX, from an installation of the lock.
sbom: $(DEV_STAMP)
	$(BIN)/uv venv -q --clear --python $(BIN)/python build/locked
	$(BIN)/uv pip install -q --python build/locked/bin/python --require-hashes -r requirements.lock
	$(SBOM) environment --pyproject pyproject.toml --output-reproducible --no-validate -o build/sbom.json \
	  build/locked/bin/python

# Known weaknesses of the locked packages. A package without an answer of the index fails too.
audit: $(DEV_STAMP)
	$(AUDIT) --strict --disable-pip --require-hashes -r requirements.lock

lint: $(DEV_STAMP)
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(DEV_STAMP)
	$(BIN)/mypy

layers: $(DEV_STAMP)
	$(BIN)/lint-imports

# Density and prose of each package; a figure that got worse fails.
house: $(STAMP)
	@$(BIN)/python tools/house

system:
	@tools/install-system-packages

system-dev:
	@tools/install-system-packages dev

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed, as in Ubuntu 24.04 or Debian 12: make PYTHON=/path/to/python3.12 ..."; exit 1; }
	@echo "Installing the grader into $(VENV), for some seconds, or a minute the first time ..."
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@test -x $(BIN)/uv || $(PIP_INSTALL) uv 2>/dev/null || true
	@$(call INSTALL,-e '.[$(EXTRAS)]')
	@$(COMPILE) || true
	@touch $@

$(DEV_STAMP): $(STAMP)
	@echo "Installing the tools for development into $(VENV) ..."
	@$(call INSTALL,-e '.[dev]')
	@touch $@

clean:
	rm -rf $(VENV) site .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
