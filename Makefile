# Every target makes the virtual environment it needs first.
PYTHON ?= python3
VENV ?= .venv
RUN := $(VENV)/bin/python
EPISODES ?= 100
OUTPUT ?= results/leaderboard

.PHONY: help install leaderboard test test-all benchmarks docs wheel clean

help:  ## show this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

# The stamp is renewed when what is installed changes. Test tools come along: one environment serves all targets.
# Type checkers do not follow the import hook of an editable installation's default mode.
$(VENV)/.installed: pyproject.toml constraints.txt Makefile
	$(PYTHON) -m venv $(VENV)
	$(RUN) -m pip install --quiet --disable-pip-version-check -c constraints.txt \
		--config-settings editable_mode=compat -e '.[test]'
	@touch $@

install: $(VENV)/.installed  ## create the virtual environment and install

leaderboard: $(VENV)/.installed  ## every built-in policy on the test splits of SingleArm and DualArmPlanar; ends with the tables
	$(RUN) evaluate.py --env SpaceCapture/SingleArm-v0 SpaceCapture/DualArmPlanar-v0 --policy all --split test --episodes $(EPISODES) --seed 0 --output $(OUTPUT) --overwrite

test: $(VENV)/.installed  ## ruff, pyright, pytest
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(VENV)/bin/pyright --pythonpath $(RUN)
	$(RUN) -m pytest -n 2

test-all: $(VENV)/.installed  ## the same with the slow scientific checks
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(VENV)/bin/pyright --pythonpath $(RUN)
	$(RUN) -m pytest -n 2 -m ''

benchmarks: $(VENV)/.installed  ## print the tables of docs/
	$(RUN) -m benchmarks

docs: $(VENV)/.installed  ## regenerate the pages that come from the code
	$(RUN) -m docs.generate

wheel: $(VENV)/.installed  ## build the wheel into dist/
	$(RUN) -m pip wheel --quiet --no-deps --wheel-dir dist .

clean:  ## remove what the targets made
	rm -rf $(VENV) build dist results runs *.egg-info
