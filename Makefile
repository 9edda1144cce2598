# The commands for developers; `make` alone lists them. Nothing has to be installed by hand but Python 3.11 or newer.

.DEFAULT_GOAL := help
.PHONY: help demo test soak with-processes simulated-faults on-vcan new-flights scenario-files coverage lint clean
.DELETE_ON_ERROR:
MAKEFLAGS += --no-builtin-rules --no-print-directory

PYTEST := .venv/bin/pytest
FRESH = .venv/bin/heronry sim --seconds 5 --jobs $(JOBS) --seed $(shell date +%s)

# Demos and tests start hundreds of Python processes: with bytecode files only the first one compiles a module.
unexport PYTHONDONTWRITEBYTECODE

help:
	@echo 'heronry: graceful degradation for CAN-bus avionics'
	@echo
	@echo '  make demo      watch an aircraft lose processors and keep flying (first time: installs into .venv)'
	@echo '                 options follow in ARGS, and ARGS=--help lists them:  make demo ARGS=--help'
	@echo '  make test      tests, in minutes: without processes, with processes, on a SocketCAN vcan0, and flights of new seeds'
	@echo '  make soak      the same with all long tests, complete: for a night'
	@echo '  make coverage  tests of cores and codec, and which of their branches these miss'
	@echo '  make lint      style, types, which package may import which, lengths of files'
	@echo '  make clean     remove .venv and everything that tools left in this folder'
	@echo
	@echo 'Then, in .venv/bin: heronry --help and pe-agent --help. For a vcan0 where the kernel has none: tools/with-vcan --help'

demo: .venv/ready-to-run
	@.venv/bin/heronry demo $(ARGS)

# Four runs of pytest: tests that compute, in parallel (but those that are part of `make lint`); tests that start
# processes and mostly wait for them, more of them at a time than there are processors; tests that pass only where this
# computer keeps up with heartbeats, one by one; and tests that need a CAN bus. Processes fly by this computer's clock,
# which may stand still for longer than a heartbeat: a test of these that fails is run once more, and reported as such.
# And flights with seeds never flown before: one that goes wrong prints the command that replays it. `test` leaves no
# processor idle: simulated flights with one and two faults take what tests with processes leave over, at the lowest
# priority; new flights and the scenario files fly beside the tests on a CAN bus, since a user-mode Linux has one
# processor. `test` and `soak` do all of this; `test` runs the long tests (tests/thoroughness.py) in part, `soak`
# completely. A test that hangs in `test` fails after 400 s and shows where it stood.
FAULTS := $(wildcard tests/scenarios/test_single_*.py tests/scenarios/test_two_*.py)
SCENARIO_FILES := tests/scenarios/test_scenario_files.py
LINTING := tests/wire/test_bytes_of_frames.py tests/lab/tests/test_clock_of_the_day.py tests/lab/tests/test_file_lengths.py
test: BUT := and not soak
test: FLIGHTS := 7
test: FLIGHTS_OF_BIG_BLUE := 3
test: AT_A_TIME := -j 2 JOBS=1
test: export PYTEST_TIMEOUT := 400
soak: FLIGHTS := 500
soak: FLIGHTS_OF_BIG_BLUE := 100
soak: AT_A_TIME := -j 1 JOBS=0
soak coverage: export HERONRY_SOAK := 1
test soak: .venv/ready-to-test
	$(PYTEST) -m 'not live and not vcan $(BUT)' -n 2 --dist worksteal $(addprefix --ignore ,$(FAULTS) $(SCENARIO_FILES) $(LINTING))
	$(MAKE) $(AT_A_TIME) with-processes simulated-faults 'BUT=$(BUT)'
	$(PYTEST) -m 'timing and not vcan $(BUT)' --reruns 1 -r R
	$(MAKE) $(AT_A_TIME) on-vcan new-flights scenario-files 'BUT=$(BUT)' FLIGHTS=$(FLIGHTS) FLIGHTS_OF_BIG_BLUE=$(FLIGHTS_OF_BIG_BLUE)

with-processes:
	$(PYTEST) -m 'live and not timing and not vcan $(BUT)' -n 6 --dist loadgroup --reruns 1 -r R

simulated-faults:
	nice -n 19 $(PYTEST) -m 'not live and not vcan $(BUT)' $(FAULTS)

# A user-mode Linux has no network: what its tests need of Debian is fetched before; without it they are skipped.
on-vcan:
	-.venv/bin/python -m lab.real_gpsd
	tools/with-vcan --timeout 1800 $(PYTEST) -m 'vcan $(BUT)' --reruns 1 -r R </dev/null

new-flights:
	$(FRESH) elevator_and_chute --runs $(FLIGHTS)
	$(FRESH) dg_specs/examples/demux_actuators.dg.yaml --standby --runs $(FLIGHTS)
	$(FRESH) dg_specs/examples/replicated_bus.dg.yaml --runs $(FLIGHTS)
	$(FRESH) dg_specs/examples/radio_link.dg.yaml --standby --runs $(FLIGHTS)
	$(FRESH) tests/scenarios/both_sides.dg.yaml --standby --runs $(FLIGHTS)
	$(FRESH) big_blue --runs $(FLIGHTS_OF_BIG_BLUE)

scenario-files:
	$(PYTEST) -m 'not live and not vcan $(BUT)' $(SCENARIO_FILES)

# Every branch of cores and codec has to be run, by the tests of one part alone: a flight that happens to come by proves
# little of a branch. Not part of `make test`.
COVERING := tests/agent tests/manager tests/wire tests/planner/test_contingencies.py tests/lab/tests/test_conformance.py
coverage: .venv/ready-to-test
	$(PYTEST) $(COVERING) -m 'not live and not vcan' -n 2 --dist worksteal --cov --cov-report=
	.venv/bin/coverage report --fail-under 100 --include "$$(.venv/bin/python -m lab.mutation.flight_code)"

lint: .venv/ready-to-test
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy
	.venv/bin/lint-imports
	$(PYTEST) $(LINTING)
	.venv/bin/heronry check --quiet dg_specs

clean:
	rm -rf .venv build dist .coverage .coverage.* htmlcov
	rm -rf .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

# Stamps: .venv was installed from this pyproject.toml. What testing needs includes what running needs.
.venv/ready-to-run: pyproject.toml
	@tools/prepare-venv manager,watch,web
	@touch $@

.venv/ready-to-test: pyproject.toml
	@tools/prepare-venv dev
	@touch .venv/ready-to-run $@
