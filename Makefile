# Every target sets up .venv by itself. Running needs no torch: `demo` installs the base, the rest installs all.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?=

.DEFAULT_GOAL := help
.PHONY: help demo test check safety firmware bench soak docs clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 12

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.base: pyproject.toml constraints.txt setup.py $(wildcard firmware_sim/c/*.[ch]) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.all: pyproject.toml constraints.txt setup.py $(wildcard firmware_sim/c/*.[ch]) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@ $(VENV)/.base

demo: $(VENV)/.base  ## run the main job: simulated wearer -> bridge -> CAN -> simulated device
	$(BIN)/hilbridge demo --seconds 30 $(if $(OUT),--out $(OUT))

test: $(VENV)/.all  ## lint, types, contracts, unit tests, and the tests on a kernel vcan0
	$(MAKE) --no-print-directory check
	$(BIN)/python -m pytest -n 2 --dist worksteal --ignore tests/system --ignore tests/vcan
	$(BIN)/python -m pytest tests/system  # real processes in real time: one after the other
	tests/vcan/run $(BIN)/python

$(VENV)/.safety: $(VENV)/.all
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test,safety]'
	@touch $@

# The hung-bridge campaign runs on a kernel bus, inside tests/vcan/run, which finds or boots one; `PART=hung` takes any bus.
safety: $(VENV)/.safety  ## prove the safety contract: model checking, mutation, fuzzing, replay, hung bridge (PART=... for one)
	$(BIN)/python -m tests.safety $(if $(PART),$(PART),--without hung)
	$(if $(PART),,VCAN_TIME_LIMIT_S=3000 VCAN_COMMAND="$(CURDIR)/$(BIN)/python -m tests.safety hung --bus vcan0" tests/vcan/run $(BIN)/python)

check: $(VENV)/.all  ## ruff, mypy --strict, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

firmware:  ## the C controller: warnings, analysis, flash and RAM on a Cortex-M4, image for the emulator
	$(MAKE) --no-print-directory -C firmware_sim/c

bench: $(VENV)/.all  ## what prediction, tick, codec and bus cost on this machine; the way from recordings to a bundle, whole
	$(BIN)/hilbridge bench
	rm -rf out/people
	$(BIN)/hilbridge data simulate out/people/train --people 12 --seconds 120
	$(BIN)/hilbridge data simulate out/people/others --people 30 --seconds 120 --seed 31000
	$(BIN)/hilbridge data simulate out/people/one --people 1 --seconds 120 --seed 32000
	$(BIN)/hilbridge train --data out/people/train --out out/people/b.safetensors --work out/people/work --jobs 2
	$(BIN)/hilbridge certify --data out/people/others --bundle out/people/b.safetensors --precision 0.5 --delta 0.1 --write out/people/c.safetensors
	$(BIN)/hilbridge adapt --data out/people/one --bundle out/people/c.safetensors --out out/people/d.safetensors
	$(BIN)/python -m tests.people.run_armed out/people/d.safetensors out/people/armed

MINUTES ?= 30
soak: $(VENV)/.all  ## the bridge for MINUTES=30 against a device: memory flat, no false trips, jitter (needs an otherwise quiet machine)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.tools.soak --minutes $(MINUTES)

docs: $(VENV)/.all  ## the documents as a site in build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

clean:  ## remove the environment and what runs have written
	rm -rf $(VENV) out build *.egg-info
