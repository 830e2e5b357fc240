# Two commands matter: `make demo` and `make test`; between two edits `make check`. All first make the environment in VENV, once: an
# interpreter that really runs (packaging/find_python.sh), a venv with Blender as a module
# (packaging/setup_env.py); what only tests need comes with the first test. That is done again when pyproject.toml
# changes; the kernels in C
# are built again when their sources do. Choose with PYTHON=/path/to/python and VENV=folder; ARGS="..." is handed on.

VENV ?= .venv
PLATFORM ?=
ARGS ?=
export PYTHON
RUN := $(VENV)/bin/python
# Dates of what an environment has: all that runs forests, the kernels in C, and all that tests need.
BLENDER := $(VENV)/blender
KERNELS := $(VENV)/kernels
READY := $(VENV)/ready

.DEFAULT_GOAL := help
.PHONY: help demo check test fuzz test-gui lint bench validate docs architecture extension wheels words clean distclean

help: ## list what can be made
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' Makefile

demo: $(KERNELS) ## grow the demo forest, run every sensor in it, results and report in out/demo
	@$(RUN) -m headless demo --out out/demo $(ARGS)

# A process a core; who is done takes over from who is not. The check leaves out tests that are marked medium or
# slow, and names what should be marked.
TESTS := $(RUN) -m pytest -n auto --maxprocesses 8 --dist worksteal

check: lint ## lint, types and the quick tests; ARGS=tests/sensing/sonar for those of a room
	@$(TESTS) -m "not medium and not slow" -q --durations=10 --durations-min=2 $(ARGS)

test: $(READY) ## run the tests, a process for each core; ARGS="-n0 tests/ui" for some, in one
	@$(TESTS) $(ARGS)

fuzz: $(READY) ## try what tests draw on new inputs until one fails or Ctrl-C, and print it as @example; ARGS=tests/sensing
	@rm -rf .hypothesis/patches; while $(RUN) -m pytest -n0 -x -q -m hypothesis --hypothesis-profile=fuzz \
		$(or $(ARGS),$$(grep -rl --include='*.py' '^@given' tests)); do :; done; \
	cat .hypothesis/patches/*.patch 2>/dev/null; false

test-gui: $(READY) ## drive the extension in a real Blender window, photographed in out/gui; BLENDER=..., ARGS="doors large"
	@$(RUN) tests/gui/run.py $(ARGS)

lint: $(READY) ## ruff on everything, mypy on the rooms that know no Blender
	@$(RUN) -m ruff check .
	@$(RUN) -m ruff format --check .
	@$(RUN) -m mypy

bench: $(READY) ## measure speed and accuracy on this machine
	@$(RUN) -m studies bench $(ARGS)

validate: $(READY) ## hold the simulations to measurements; ARGS="reverb --data FOLDER"
	@$(RUN) -m studies validate $(ARGS)

docs: $(READY) ## build the documentation site in build/site; it runs the notebooks
	@$(RUN) -c "import sphinx, furo, myst_nb" 2>/dev/null || $(RUN) -m pip install --quiet --editable ".[docs]"
	@$(RUN) -m sphinx --quiet --fail-on-warning --keep-going -b html docs build/site
	@echo "build/site/index.html"

extension: $(READY) ## build the Blender extension in build/; PLATFORM=all for every system
	@$(RUN) packaging/build_extension.py $(PLATFORM)

wheels: $(READY) ## build the wheels of every platform in build/
	@$(RUN) packaging/build_wheels.py $(PLATFORM)

words: $(READY) ## write the template for translators, build/forest_sensing.pot
	@$(RUN) packaging/list_words.py

architecture: $(READY) ## draw docs/pictures/architecture.png anew, from the imports of the code
	@PYTHONPATH=. $(RUN) packaging/draw_architecture.py

clean: ## remove caches, build/ and out/demo
	@rm -rf build out/demo *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis
	@find . -name '.venv*' -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## clean, and remove the environment and the downloaded wheels
	@rm -rf "$(VENV)" wheels

$(KERNELS): packaging/build_kernels.py $(wildcard forest_addon/kernels/*.[ch]) | $(BLENDER)
	@$(RUN) packaging/build_kernels.py --fetch; touch $@

$(BLENDER): pyproject.toml
	@python=$$(sh packaging/find_python.sh) && "$$python" packaging/setup_env.py "$(VENV)" bpy

$(READY): pyproject.toml | $(KERNELS)
	@python=$$(sh packaging/find_python.sh) && "$$python" packaging/setup_env.py "$(VENV)"
