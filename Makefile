# "make help" lists the targets. They make their own environment in .venv; PYTHON chooses the
# interpreter it is made with: make test PYTHON=python3.12

PYTHON ?= python3
VENV ?= .venv
PYTEST_ARGS ?=
# Test processes that run at once, two more than there are cores in most places that run them: those
# on ROS 2 often wait.  A file's tests stay together, because they share what they set up.
TEST_JOBS ?= 4

# Programs start hundreds of times here, and would compile all that they import each time.
unexport PYTHONDONTWRITEBYTECODE

BIN := $(VENV)/bin
# Modules become bytecode when they are first loaded, which most never are: doing it for all takes
# as long as installing them.
INSTALL := $(BIN)/python -m pip install -qq --disable-pip-version-check --no-compile
PINNED := $(INSTALL) --constraint constraints.txt
MESSAGES := $(wildcard msg_schemas/* msg_schemas/*/*)

# Each stamp stands for one step of the set-up, and is as old as its last run.
OFFLINE := $(VENV)/.stamp-offline
TOOLS := $(VENV)/.stamp-tools
FULL := $(VENV)/.stamp-full

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test lint format bench readme scores gates figures docs test-lower-bounds test-newest \
  test-ubuntu release-check constraints clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' Makefile | column -t -s '|' 2>/dev/null \
	  || sed -n 's/^\([a-z-]*\):.*## /  make \1: /p' Makefile

demo: $(OFFLINE) ## simulate robots, map what they hear, draw it: into demo_output
	@echo "Running the demo: usmap demo -o demo_output"
	@$(BIN)/usmap demo -o demo_output

# Tests run even where the linters complain: one run shows everything there is to mend.  They begin
# with the files whose tests take longest (test/conftest.py).
test: $(TOOLS) ## run linters and all tests, those on ROS 2 included
	@$(MAKE) --no-print-directory lint & lint=$$!; \
	$(MAKE) --no-print-directory --silent $(FULL) || exit; \
	$(BIN)/usmap compile; wait $$lint; lint=$$?; \
	echo "Running the tests"; \
	$(BIN)/python -m pytest -n $(TEST_JOBS) --dist loadfile --no-loadscope-reorder --timeout=600 \
	  $(PYTEST_ARGS); tests=$$?; \
	if [ $$lint -ne 0 ]; then exit $$lint; else exit $$tests; fi

lint: $(TOOLS) ## check style and types
	@status=0; \
	echo "Checking style"; \
	$(BIN)/ruff check --quiet . || status=1; \
	$(BIN)/ruff format --check . || { echo "make format mends that"; status=1; }; \
	echo "Checking types"; \
	$(BIN)/mypy || status=1; \
	exit $$status

format: $(TOOLS) ## format the code
	@$(BIN)/ruff check --quiet --fix-only .
	@$(BIN)/ruff format .

bench: $(FULL) ## measure speed and memory
	@$(BIN)/python benchmarks/run.py

readme: $(FULL) ## make the README's pictures and table anew
	@$(BIN)/usmap demo -o demo_output
	@for picture in map.gif map.png range_only.png normals.png ambiguity.png ping.png; do \
	  cp demo_output/$$picture docs/images/demo_$$picture; done
	@$(BIN)/python benchmarks/scores.py --targets --report --jobs 2 --readme README.md

scores: $(FULL) ## compare methods, and measure how reliable probabilities are: into docs/benchmarks.md
	@$(BIN)/python benchmarks/scores.py --targets --report --jobs 2 --page docs/benchmarks.md
	@$(BIN)/python benchmarks/reliability.py --jobs 2 --page docs/benchmarks.md

gates: $(FULL) ## store how well test/acceptance maps its scenes, which no change may do worse
	@$(BIN)/python benchmarks/gates.py --rewrite

figures: $(FULL) ## reproduce the paper's figures: into figures
	@$(BIN)/usmap paper -o figures

docs: $(FULL) ## regenerate the reference pages from the code
	@if [ -e tools/make_reference.py ]; then $(BIN)/python tools/make_reference.py; \
	else echo "Nothing is generated yet."; fi

# In an environment of its own, without ROS; the tests that need it are skipped.
test-lower-bounds: ## run the tests against the oldest versions that setup.py allows
	@$(MAKE) --no-print-directory $(VENV)-lower/pyvenv.cfg VENV=$(VENV)-lower
	@echo "Installing the oldest versions allowed"
	@$(VENV)-lower/bin/python -m pip install --quiet --disable-pip-version-check \
	  --constraint test/packaging/lower-bounds.txt --constraint test/packaging/contemporaries.txt \
	  --editable '.[test]'
	@$(VENV)-lower/bin/usmap compile
	@$(VENV)-lower/bin/python -m pytest --timeout=600 -m "not ros" $(PYTEST_ARGS)

# Without constraints, so that a new release of Numba, above all, is met here first.
test-newest: ## run the tests against the newest releases of all that is needed, without ROS
	@$(MAKE) --no-print-directory $(VENV)-newest/pyvenv.cfg VENV=$(VENV)-newest
	@echo "Installing the newest versions"
	@$(VENV)-newest/bin/python -m pip install --quiet --disable-pip-version-check \
	  --upgrade --upgrade-strategy eager --editable '.[test]'
	@$(VENV)-newest/bin/python -m pip list --format freeze | grep -iE '^(numba|llvmlite|numpy)='
	@$(VENV)-newest/bin/usmap compile
	@$(VENV)-newest/bin/python -m pytest --timeout=600 -m "not ros" $(PYTEST_ARGS)

# With ROS from wheels, since Ubuntu's own packages of it need Ubuntu; PYTHON=python3.12 is Ubuntu's.
test-ubuntu: ## run the tests against the versions of Ubuntu 24.04, nodes included (PYTHON=python3.12)
	@$(MAKE) --no-print-directory $(VENV)-ubuntu/pyvenv.cfg VENV=$(VENV)-ubuntu
	@echo "Installing the versions of Ubuntu 24.04, and ROS 2 Jazzy"
	@$(VENV)-ubuntu/bin/python -m pip install --quiet --disable-pip-version-check \
	  --constraint test/packaging/ubuntu-24.04.txt --editable '.[test,ros]' ./msg_schemas
	@$(VENV)-ubuntu/bin/usmap compile
	@$(VENV)-ubuntu/bin/python -m pytest --timeout=600 -m "not slow" $(PYTEST_ARGS)

# In an environment of its own, with the newest tools; from a copy that has what git has.
release-check: ## build both packages as for a release, and check what an index would
	@$(MAKE) --no-print-directory $(VENV)-release/pyvenv.cfg VENV=$(VENV)-release
	@$(VENV)-release/bin/python -m pip install --quiet --disable-pip-version-check build twine
	@rm -rf dist && mkdir -p dist/source
	@git ls-files -z | tar --create --null --files-from - | tar --extract --directory dist/source
	@$(VENV)-release/bin/python -m build --outdir dist dist/source
	@$(VENV)-release/bin/python -m build --sdist --outdir dist dist/source/msg_schemas
	@rm -rf dist/source
	@$(VENV)-release/bin/python -m twine check --strict dist/*

# Give one interpreter for each Python version that is supported.
PYTHONS ?= python3.10 python3.11 python3.12 python3.13
constraints: ## pin the newest versions anew
	@$(PYTHON) tools/pin_versions.py $(PYTHONS)

clean: ## remove what the other targets made
	rm -rf $(VENV) $(VENV)-lower $(VENV)-newest $(VENV)-ubuntu $(VENV)-release build install log dist src/*.egg-info
	rm -rf .hypothesis .mypy_cache .pytest_cache .ruff_cache demo_output figures bench_output
	find src test tools -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  echo >&2 "usmap_ros needs Python 3.10 or later. Name one: make PYTHON=python3.12"; exit 1; }
	@echo "Making $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV) >$(VENV).log 2>&1 \
	|| { $(PYTHON) -m venv --clear --without-pip $(VENV) >>$(VENV).log 2>&1 \
	  && $(PYTHON) -m pip --python $(BIN)/python install --quiet pip >>$(VENV).log 2>&1; } \
	|| { cat >&2 $(VENV).log; rm -rf $(VENV) $(VENV).log; \
	  echo >&2 "No virtual environment could be made. On Debian and Ubuntu the package"; \
	  echo >&2 "python3-venv is needed: sudo apt install python3-venv"; exit 1; }
	@rm -f $(VENV).log

# The inner loops are compiled on one core while pip installs the rest on another.  Who needs them
# before that is done waits for it, and does what is missing.
COMPILER_NEEDS := numba numpy pydantic PyYAML scipy
COMPILE := from usmap_ros.runs.compilation import compile_if_needed; compile_if_needed(print)

$(OFFLINE): $(VENV)/pyvenv.cfg setup.py setup.cfg pyproject.toml constraints.txt
	@echo "Installing usmap_ros and what it needs (about a minute, once)"
	@$(PINNED) $(COMPILER_NEEDS)
	@PYTHONPATH=$(CURDIR)/src $(BIN)/python -c "$(COMPILE)" >$(VENV)/compile.log 2>&1 & \
	$(PINNED) --editable .
	@touch $@

$(TOOLS): $(OFFLINE)
	@echo "Installing ROS 2 and the tools (a minute, once)"
	@$(PINNED) --editable '.[dev,ros]'
	@touch $@

# pip would install what the build needs, ROS 2 included, a second time for this alone.
$(FULL): $(TOOLS) $(MESSAGES)
	@echo "Compiling the messages (a minute, once)"
	@$(BIN)/python tools/build_requirements.py msg_schemas >$(VENV)/build_requirements.txt
	@$(PINNED) --requirement $(VENV)/build_requirements.txt
	@$(PINNED) --no-build-isolation --force-reinstall --no-deps ./msg_schemas
	@touch $@
