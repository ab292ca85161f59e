# `make run` flies the demo, `make test` runs every test; both set up .venv first.
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3

.PHONY: help run test sitl check lint format venv clients mosquitto chromium bench crash docs fuzz soak soak-mutants clean
.DEFAULT_GOAL := help

help:  ## list what can be made
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:[^#]*## /\t/' | expand -t 14

run: venv  ## fly the demo mission: ten UAVs search an office floor
	$(BIN)/swarm-ctl run missions/usar_office.yaml --speed 4

test: clients mosquitto chromium  ## run every test
	$(BIN)/pytest -n auto

sitl: venv  ## fly real autopilots' simulators: SWARM_SITL_ARDUCOPTER and SWARM_SITL_PX4 (docs/real_vehicles.md)
	@test -n "$$SWARM_SITL_ARDUCOPTER$$SWARM_SITL_PX4" || { echo "\
	set SWARM_SITL_ARDUCOPTER=/path/to/arducopter or SWARM_SITL_PX4=/path/to/px4/build, or both"; exit 1; }
	$(BIN)/pytest tests/sitl

check: lint test  ## what CI runs

lint: clients  ## format check, lint, types, import contracts
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python hatch_build.py >$(VENV)/mypyc.log || { grep -v warning: $(VENV)/mypyc.log; exit 1; }

format: venv  ## format and fix in place
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: venv  ## build the documentation as a site into build/site; a warning is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "build/site/index.html"

bench: venv  ## measure what docs/performance.md tells of (15 minutes); figures as JSON in build/bench
	$(BIN)/python benchmarks/run.py

crash: venv  ## kill the controllers of ten flying vehicles ten times (7 minutes)
	$(BIN)/python benchmarks/crash.py

fuzz: venv  ## throw a million mutated frames at mock vehicles
	$(BIN)/python benchmarks/fuzz.py

soak: venv  ## fly ten thousand missions drawn by seed (hours on one core), and go on where it was stopped
	$(BIN)/swarm-ctl soak --seeds 1..10000 --out runs/soak.jsonl

soak-mutants: venv  ## put bugs in on purpose, and see that the soak finds each within 200 seeds
	$(BIN)/python benchmarks/soak_mutants.py

venv: $(VENV)/.stamp  ## set up .venv with every extra

$(VENV)/.stamp: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or newer is needed; set PYTHON=/path/to/python3.11"; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[all]'
	touch $@

clients: venv $(VENV)/.clients  ## add the third-party clients that tests fly the mock with (1 GB)

$(VENV)/.clients: pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[clients]'
	touch $@

mosquitto:  ## install the MQTT broker that tests start, if it is missing and we are root
	@PATH="$$PATH:/usr/sbin"; command -v mosquitto >/dev/null || { test "$$(id -u)" = 0 \
	  && { apt-get install -y -q mosquitto || { apt-get update -q && apt-get install -y -q mosquitto; }; } \
	} || echo "mosquitto is missing and cannot be installed: tests of the bus are skipped"

chromium:  ## install the browser that tests of the console open, if it is missing and we are root
	@command -v chromium >/dev/null || { test "$$(id -u)" = 0 \
	  && { apt-get install -y -q chromium || { apt-get update -q && apt-get install -y -q chromium; }; } \
	} || echo "chromium is missing and cannot be installed: tests of the console's pages are skipped"

clean:  ## remove the virtual environment, runs and caches
	rm -rf $(VENV) runs build .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
