# Every common action has a name here. No system package is needed, only Python >= 3.11.
PY ?= python3
BIN := .venv/bin
RUNS := .venv/.runs
STAMP := .venv/.installed
TOOLS := .venv-tools/.installed
LOCKED := build/locked/.installed

.PHONY: run test test-long test-compose test-chaos check format lock sbom bench bench-retarget bench-robosuite bench-inference bench-loader bench-remote bench-soak clean help
.DEFAULT_GOAL := help

help:   ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

$(RUNS): pyproject.toml constraints.txt
	$(PY) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python >= 3.11 is needed, this is " + sys.version)'
	$(PY) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all]'
	$(BIN)/python -m services.sim.camera
	@touch $@

# What only development needs; PyTorch is the largest part.
$(STAMP): $(RUNS)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

run: $(RUNS)   ## set up, evaluate the lid task on two robots, write a report
	@$(BIN)/legato demo

test: $(STAMP)  ## all tests
	$(BIN)/python -m pytest

test-long: $(STAMP) ## fuzzing and holding still, which take minutes
	$(BIN)/python -m pytest -m long

test-compose: $(STAMP) ## images and containers; needs a container engine with Compose 2.24 or later
	$(BIN)/python -m pytest -m compose tests/compose

test-chaos: $(STAMP) ## processes and links that fail while evaluations run or a robot moves
	$(BIN)/python -m pytest -m chaos tests/chaos tests/integration/test_safe_stop.py

check: $(STAMP) ## format, lint, types, import contract
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports

format: $(STAMP) ## rewrite the code in the house format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# uv resolves for every platform and knows the hashes; cyclonedx-bom reads an environment.
$(TOOLS):
	$(PY) -m venv .venv-tools
	.venv-tools/bin/python -m pip install --quiet --disable-pip-version-check cyclonedx-bom==7.5.0 uv==0.13.9
	@touch $@

COMPILE := .venv-tools/bin/uv pip compile --quiet --universal --python-version 3.11 \
	--generate-hashes --no-annotate --custom-compile-command 'make lock'
lock: $(TOOLS) ## write what runs without PyTorch, and what builds the images, with hashes
	$(COMPILE) --extra all --constraint constraints.txt --output-file requirements.lock pyproject.toml
	$(COMPILE) --group image --output-file requirements-build.lock

$(LOCKED): requirements.lock $(TOOLS)
	$(PY) -m venv --clear --without-pip build/locked
	.venv-tools/bin/python -m pip --python build/locked/bin/python install --quiet \
	  --disable-pip-version-check --no-compile --require-hashes -r requirements.lock
	@touch $@

sbom: $(TOOLS) $(LOCKED) ## write build/sbom.json (CycloneDX) of what requirements.lock installs
	.venv-tools/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible \
	  --output-format JSON --output-file build/sbom.json build/locked/bin/python

bench: $(STAMP) ## speed of an evaluation, in one process and over processes
	$(BIN)/python -m benchmarks.evaluation

bench-retarget: $(STAMP) ## speed and accuracy of the retargeter beside Pink and mink
	@# mink asks for the package mujoco, which would overwrite the files of mujoco-core.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps mink==1.3.0
	$(BIN)/python -m benchmarks.retarget

bench-robosuite: $(STAMP) ## speed of the full loop beside robosuite, in its own environment
	$(BIN)/python -m benchmarks.versus_robosuite

bench-inference: $(STAMP) ## speed of a learned policy, for one cell and for eight
	$(BIN)/python -m benchmarks.inference

bench-loader: $(STAMP) ## speed at which training gathers its windows
	$(BIN)/python -m benchmarks.loader

bench-remote: $(STAMP) ## round trip of a remote policy beside two other policy servers
	$(BIN)/python -m benchmarks.versus_policy_servers

bench-soak: $(STAMP) ## an hour in real time: latency, and what grows
	$(BIN)/python -m benchmarks.soak --minutes 60

clean:  ## remove the environments, what was built, and results
	rm -rf .venv .venv-policy-servers .venv-robosuite .venv-tools build runs
