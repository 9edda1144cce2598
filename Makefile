# What a person types here. `make` alone explains; nothing has to be installed by hand but Python 3.11 or newer.

.DEFAULT_GOAL := help
.PHONY: help demo test soak coverage lint clean
.DELETE_ON_ERROR:
MAKEFLAGS += --no-builtin-rules --no-print-directory

PYTEST := .venv/bin/pytest
FRESH := .venv/bin/heronry sim --seconds 5 --jobs 0 --seed $(shell date +%s)

# Demos and tests start hundreds of Pythons: what one of them has compiled, the next need not compile again.
unexport PYTHONDONTWRITEBYTECODE

help:
	@echo 'heronry: graceful degradation for CAN-bus avionics'
	@echo
	@echo '  make demo      watch an aircraft lose processors and keep flying (first time: installs into .venv)'
	@echo '                 options follow in ARGS, and ARGS=--help lists them:  make demo ARGS=--help'
	@echo '  make test      tests, in minutes: ordinary ones, live processes, a real SocketCAN vcan0, and flights of fresh seeds'
	@echo '  make soak      the same, and all that is long, to its end: for a night'
	@echo '  make coverage  the ordinary ones, long ones too, and which branches of the code they miss'
	@echo '  make lint      style, types, and which room may import which'
	@echo '  make clean     remove .venv and everything that tools left in this folder'
	@echo
	@echo 'Then, in .venv/bin: heronry --help and pe-agent --help. For a vcan0 where the kernel has none: tools/with-vcan --help'

demo: .venv/ready-to-run
	@.venv/bin/heronry demo $(ARGS)

# Four runs: in parallel what computes; in parallel, and more than there are processors, what starts processes and mostly
# waits for them; one by one what holds only where this computer keeps up with heartbeats; and on a CAN bus what needs
# one. Processes are flown by this computer's clock, and it may stand still for longer than a heartbeat: what fails there
# is tried once more, and said to have been. Then flights that nobody has flown yet: one that goes wrong prints what
# replays it. Both targets do all of this: what is long (tests/thoroughness.py) in part in `test`, to its end in `soak`.
test: BUT := and not soak
test: FLIGHTS := 40
test: FLIGHTS_OF_BIG_BLUE := 8
soak: FLIGHTS := 500
soak: FLIGHTS_OF_BIG_BLUE := 100
soak coverage: export HERONRY_SOAK := 1
test soak: .venv/ready-to-test
	$(PYTEST) -m 'not live and not vcan $(BUT)' -n 2 --dist worksteal
	$(PYTEST) -m 'live and not timing and not vcan $(BUT)' -n 4 --dist loadgroup --reruns 1 -r R
	$(PYTEST) -m 'timing and not vcan $(BUT)' --reruns 1 -r R
	tools/with-vcan --timeout 1800 $(PYTEST) -m 'vcan $(BUT)' --reruns 1 -r R
	$(FRESH) elevator_and_chute --runs $(FLIGHTS)
	$(FRESH) dg_specs/examples/demux_actuators.dg.yaml --standby --runs $(FLIGHTS)
	$(FRESH) dg_specs/examples/replicated_bus.dg.yaml --runs $(FLIGHTS)
	$(FRESH) dg_specs/examples/radio_link.dg.yaml --standby --runs $(FLIGHTS)
	$(FRESH) tests/scenarios/both_sides.dg.yaml --standby --runs $(FLIGHTS)
	$(FRESH) big_blue --runs $(FLIGHTS_OF_BIG_BLUE)

# By branches, and with all that is long: no part of `make test`. Cores and codec have to have all of them.
coverage: .venv/ready-to-test
	$(PYTEST) -m 'not live and not vcan' -n 2 --dist worksteal --cov
	.venv/bin/coverage report --fail-under 100 --include "$$(.venv/bin/python -m lab.mutation.flight_code)"

lint: .venv/ready-to-test
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy
	.venv/bin/lint-imports
	$(PYTEST) tests/wire/test_bytes_of_frames.py
	.venv/bin/heronry check --quiet dg_specs

clean:
	rm -rf .venv build dist .coverage .coverage.* htmlcov
	rm -rf .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

# Stamps: what .venv holds is as new as pyproject.toml. All that testing needs includes all that running needs.
.venv/ready-to-run: pyproject.toml
	@tools/prepare-venv manager,watch
	@touch $@

.venv/ready-to-test: pyproject.toml
	@tools/prepare-venv dev
	@touch .venv/ready-to-run $@
