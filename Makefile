PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lint types contracts unit install benchmark reference recorded clean docs/scenario-file.md

# The main job: a shipped highway-env scenario to a result, a report and a recording.
demo: $(VENV)/.installed
	$(BIN)/trackbench run scenarios/highway.yaml
	@echo "Open results/highway/report.html in a browser, and the recording with:"
	@echo "  $(BIN)/rerun results/highway/recording.rrd"

# Everything that must hold of a commit.
test: $(VENV)/.installed-dev lint types contracts unit

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

contracts: $(VENV)/.installed-dev
	$(BIN)/lint-imports

unit: $(VENV)/.installed-dev
	$(BIN)/pytest -n auto

install: $(VENV)/.installed

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	@touch $@ $(VENV)/.installed

# Everything that is committed under results/ and docs/ and made by a command.
reference: $(VENV)/.installed docs/scenario-file.md
	$(BIN)/trackbench run scenarios/
	$(BIN)/python docs/projects/range_3km.py

# The tables of the Udacity pages; needs TRACKBENCH_DATA.
recorded: $(VENV)/.installed
	$(BIN)/python docs/projects/udacity.py

docs/scenario-file.md: $(VENV)/.installed
	$(BIN)/python -m trackbench.scenario.docs > $@

benchmark: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/speed.py

clean:
	rm -rf $(VENV) build dist src/*.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
