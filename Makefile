PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
GENERATED := docs/scenario-file.md docs/command-line.md docs/glossary.md docs/doctor-reference.md

.PHONY: help demo quick test test-all test-long fuzz real-faults calibration calibrated-worlds radar worlds published lint types contracts docs install benchmark pins same-numbers printed tuned suite drivers envelopes reference recorded clean $(GENERATED)

help:
	@echo "make demo      install into .venv and run a motorway scene: result, report and recording in results/highway"
	@echo "make quick     linter, and the fast tests of what differs from a commit (SINCE=HEAD): two minutes at most"
	@echo "make test      linter, types, import contracts, documentation site and tests: about 7 minutes on 2 cores"
	@echo "make test-all  the same, with the slow tests and the commands of the documentation's pages as they are printed"

# The main job: a shipped highway-env scenario to a result, a report and a recording.
demo: $(VENV)/.installed
	@echo "3 of 3: $(BIN)/trackbench run scenarios/highway.yaml"
	@$(BIN)/trackbench run scenarios/highway.yaml
	@echo "The recording:  $(BIN)/trackbench view results/highway"
	@echo "The report, for a browser:  $(CURDIR)/results/highway/report.html"

# While one works: the linter, and the fast tests of what differs from a commit.
SINCE ?= HEAD
quick: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@tests=$$($(BIN)/python -m tests.support.changed $(SINCE)); \
	if [ -z "$$tests" ]; then echo "no tests of what differs from $(SINCE)"; else \
	echo "$$tests"; timeout 110 $(BIN)/pytest -q -x -n auto --dist worksteal -m "not docs_pages and not slow" $$tests; \
	status=$$?; if [ $$status = 124 ]; then echo "none failed in two minutes; make test runs the rest"; else exit $$status; fi; fi

# What a change is tried with. Tests that need Chromium or a Vulkan driver are skipped where it is missing.
test: $(VENV)/.installed-dev
	$(MAKE) -j2 lint types contracts docs
	$(BIN)/pytest -n auto --dist worksteal -m "not docs_pages and not slow"

# The slow tests, and the commands of the documentation's pages as they are printed; PART=0 to 7 takes one of eight parts.
test-long: $(VENV)/.installed-dev
	$(BIN)/pytest -n auto --dist worksteal -m "docs_pages or slow" $(if $(PART),--part $(PART))

# The outputs that README and docs/ print, made anew; read the difference before it is committed.
printed: $(VENV)/.installed-dev
	TRACKBENCH_REPRINT=1 $(BIN)/pytest -m docs_pages

# Everything that must hold of a commit.
test-all: test test-long

# Damaged scenarios, recordings, results and files of tracks: five hours. FUZZ_FROM goes on where another run ended.
FUZZ_FROM ?= 0
fuzz: $(VENV)/.installed-dev
	TRACKBENCH_FUZZ_FROM=$(FUZZ_FROM) TRACKBENCH_FUZZ=20000 $(BIN)/pytest tests/fuzz/test_fuzz_scenarios.py
	TRACKBENCH_FUZZ_FROM=$(FUZZ_FROM) TRACKBENCH_FUZZ=10000 $(BIN)/pytest tests/fuzz/test_fuzz_recordings.py
	TRACKBENCH_FUZZ_FROM=$(FUZZ_FROM) TRACKBENCH_FUZZ=3000 $(BIN)/pytest tests/fuzz/test_fuzz_results.py
	TRACKBENCH_FUZZ_FROM=$(FUZZ_FROM) TRACKBENCH_FUZZ=3000 $(BIN)/pytest tests/fuzz/test_fuzz_tracks.py

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

contracts: $(VENV)/.installed-dev
	$(BIN)/lint-imports

# The documentation as a site, in build/docs, searchable without a network; a broken link fails.
docs: $(VENV)/.installed-dev
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going docs build/docs

install: $(VENV)/.installed

$(BIN)/python:
	@echo "1 of 3: making $(VENV)"
	@$(PYTHON) -m venv $(VENV)

# Each file that is installed has one of the hashes that are written down; the package is built by the setuptools among them.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

$(VENV)/.installed: pyproject.toml requirements/run.txt | $(BIN)/python
	@echo "2 of 3: installing $$(grep -c == requirements/run.txt) packages and trackbench into $(VENV)"
	@$(PIP) --require-hashes --only-binary :all: -r requirements/run.txt
	@$(PIP) --no-deps --no-build-isolation -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml requirements/dev.txt | $(BIN)/python
	$(PIP) --require-hashes --only-binary :all: -r requirements/dev.txt
	$(PIP) --no-deps --no-build-isolation -e .
	@touch $@ $(VENV)/.installed

# Versions and hashes of requirements/, for Python 3.11 and newer on any system; UPGRADE=--upgrade takes the newest.
LOCK = $(BIN)/uv pip compile pyproject.toml --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate
pins: $(VENV)/.installed-dev
	echo "setuptools>=77" | $(LOCK) $(UPGRADE) - --extra fast -o requirements/run.txt
	$(LOCK) $(UPGRADE) --extra dev -c requirements/run.txt -o requirements/dev.txt

# Everything that is committed under results/ and docs/ and made by a command.
reference: $(VENV)/.installed $(GENERATED)
	# What is expected of one scene need not hold over ten.
	-$(BIN)/trackbench run scenarios/ --scenes 10 --runs 20 --workers 2 --no-recording
	$(BIN)/trackbench run scenarios/traffic --workers 2 --no-recording --out results/traffic
	$(BIN)/python docs/projects/range_3km.py

# The tables of the Udacity pages; needs TRACKBENCH_DATA.
recorded: $(VENV)/.installed
	$(BIN)/python docs/projects/udacity.py

docs/scenario-file.md: $(VENV)/.installed
	$(BIN)/python -m trackbench.scenario.docs docs

docs/command-line.md: $(VENV)/.installed
	$(BIN)/python -m trackbench.cli.docs > $@

docs/glossary.md: $(VENV)/.installed
	$(BIN)/python -m trackbench.cli.explain > $@

docs/doctor-reference.md: $(VENV)/.installed
	$(BIN)/python -m trackbench.subjects.doctor.docs > $@

benchmark: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.speed

# That this source gives the same numbers as a commit, or as the folder of another checkout, to the last bit: about ten
# minutes for each of the two.
OLD ?= HEAD
same-numbers: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.same_numbers $(OLD)

# A radar with typical effects beside the real one of comma2k19, which TRACKBENCH_DATA has: results/radar.
radar: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.radar

# The trackers of highway in each world: compared, and tuned in one and scored in another; results/worlds.
worlds: $(VENV)/.installed-dev
	$(BIN)/trackbench run highway --worlds ideal,human,typical,recorded --scenes 20 --runs 20 --no-recording \
	  --out results/worlds
	$(BIN)/python -m benchmarks.worlds

# Published numbers beside ours, and where we differ: results/published; needs TRACKBENCH_DATA; a minute.
published: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.published

# The envelopes that come with trackbench: some ten minutes.
envelopes: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.envelopes

# What the statistics claim, measured by simulation: a table in results/; fails where a claim does not hold.
calibration: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.calibration

# How often an equal tracker is called better in each world, on scenes that are simulated anew: ten minutes on two cores.
calibrated-worlds: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.calibration.worlds
	$(BIN)/python -m benchmarks.calibration worlds

# Every tracker tuned by one protocol, and compared on other scenes: results/tuned; about an hour on two cores.
tuned: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.tuned

# The first entries of trackbench-road-1, by built-in trackers, FilterPy and Stone Soup: results/suite; an hour of one core.
suite: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.suite

# Simulated drivers fitted to recorded traffic, and trackers with them: results/drivers; needs TRACKBENCH_DATA; ten minutes.
drivers: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.drivers fit
	$(BIN)/python -m benchmarks.drivers reversal

# What the doctor says of faults that people made, and of the sound trackers they are put into; four CPU minutes.
real-faults: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks.faults.rates

clean:
	rm -rf $(VENV) build dist src/*.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
