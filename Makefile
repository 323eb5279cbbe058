# Isoshape: `make demo` shows it, `make test` tests it. `make help` lists the rest.
#
# Needs Python 3.11 or newer (with venv) and the Python package index; everything else is installed into .venv,
# at the versions and hashes of the lock files. `image-test` needs root on Debian, and says so; so does `kill-test`
# where there is no C compiler.

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

# The first interpreter that is new enough and can make environments. Any other: make PYTHON=/path/to/python3.12
PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11; do \
	$$python -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$python && break; \
	done)

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -B -m pip -qq --disable-pip-version-check
PACKAGES := $(VENV)/.packages
RUNTIME := $(VENV)/.runtime
DEV := $(VENV)/.dev
BROWSER := $(VENV)/.browser
SUPPLY := $(VENV)/supply
NODE := tests/soak/page/node_modules/.package-lock.json

# uv reads no configuration here, so that the lock files never depend on, or tell of, the machine they were made on.
UV ?= $(BIN)/uv
COMPILE := $(UV) pip compile --quiet --no-config --universal --python-version 3.11 --fork-strategy fewest \
	--generate-hashes --no-annotate --custom-compile-command 'make lock' $(if $(UPGRADE),--upgrade)
LOCKS := requirements.lock tests/requirements.lock tests/soak/browser/requirements.lock docker/cluster.lock docker/test/requirements.lock \
	tests/soak/supply/requirements.lock

.PHONY: help environment demo test soak kill-test load-test cluster-test postgresql-test method-test studies-test hostile-test \
	schema-test collections-test lint types openapi lock lock-check image-test page-lint page-vendor browser-test screenshots \
	sbom audit clean

help:
	@echo 'make demo               ingest generated shapes, query them, print the nearest three (CHECK=1: also check them; PORT=)'
	@echo 'make environment        install the runtime and the test tools into .venv, and compile the kernels'
	@echo 'make test               the quick test suite of the library and the service'
	@echo 'make lint types         ruff: rules and layout; mypy --strict'
	@echo 'make openapi            write openapi/openapi.json'
	@echo
	@echo 'make soak               every test that runs for minutes, one after another: the next eight'
	@echo 'make kill-test          kill the service while clients write (CYCLES=200), and at each write (POINTS=60: at some)'
	@echo 'make load-test          mixed load: answers, and the growth of memory (MINUTES=20); a flood by one key'
	@echo 'make cluster-test       a Dask cluster that loses its workers and its scheduler'
	@echo 'make postgresql-test    the tests of the service that depend on the database, on PostgreSQL'
	@echo 'make method-test        the method on every class of the gallery, and its machine code'
	@echo 'make studies-test       every study on small collections'
	@echo 'make hostile-test       every hostile file, and mutations of valid ones, over HTTP (COUNT=10000 SEED=0)'
	@echo 'make schema-test        requests generated from the OpenAPI document (SEED=0)'
	@echo
	@echo 'make collections-test   real collections, in the folder that ISOSHAPE_DATA names (SAMPLE=64: 64 shapes of each)'
	@echo 'make browser-test       the page in Chromium, which is installed if it is missing (root, Debian)'
	@echo 'make page-lint          check the scripts of the page with tsc, and the vendored files (npm)'
	@echo 'make image-test         build the image and run it as it is deployed (root, Debian, no Docker engine needed)'
	@echo
	@echo 'make page-vendor        bundle the vendored files of the page (npm)'
	@echo 'make screenshots        draw docs/page-*.png (needs the tools of browser-test)'
	@echo 'make lock lock-check    bring the lock files up to pyproject.toml (UPGRADE=1: to the newest releases); check them'
	@echo 'make sbom audit         write build/isoshape.cdx.json, a bill of materials; ask for vulnerabilities of the packages'
	@echo 'make clean              remove the files that these targets make'

# The environment is made again when its lock changes. Three files mark its state: the locked packages, this project
# (whose build fetches setuptools into an environment of its own), and the tools for its tests. A lock written again
# with the same content, as by a checkout, installs nothing; an interrupted installation continues. The tests of
# packages go. Modules are compiled here: a process that imports one with a full disk would leave half of it behind.
$(PACKAGES): requirements.lock
	@test -n "$(PYTHON)" && $(PYTHON) -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' || { \
		echo 'Python 3.11 or newer with venv is needed and was not found; name one: make PYTHON=/path/to/python3' >&2; exit 1; }
	@cmp -s requirements.lock $@ || { echo 'Installing about 560 MB into $(VENV).'; \
		cmp -s requirements.lock $(VENV)/.begun || $(PYTHON) -m venv --clear $(VENV); cp requirements.lock $(VENV)/.begun; \
		$(PIP) install --no-compile --require-hashes --requirement requirements.lock; \
		$(PIP) uninstall --yes setuptools; \
		find $(VENV)/lib -depth \( -path '*/pip/*.pyc' -o -path '*/tests/*' \) -delete; \
		$(BIN)/python -m compileall -q -j 0 -x '/pip/' $(VENV)/lib; }
	@cp requirements.lock $@

$(RUNTIME): pyproject.toml $(PACKAGES)
	$(PIP) install --no-deps --editable .
	@touch $@

$(DEV): tests/requirements.lock $(RUNTIME)
	$(PIP) install --require-hashes --requirement tests/requirements.lock
	@touch $@

# The kernels are compiled here, once: services and test workers would otherwise wait for it when they first start.
environment: $(DEV)
	@$(BIN)/isoshape compile

demo: $(RUNTIME)
	@$(BIN)/isoshape demo $(if $(filter-out 0,$(CHECK)),--check) $(if $(PORT),--port $(PORT))

# Two workers suit two cores, with one thread each: more threads would compete for the cores.
# The tests of a file run in one worker, so that their fixtures start once; files run in the order of their names.
WORKERS ?= 2
AT_A_TIME := -n $(WORKERS) --dist loadfile --no-loadscope-reorder
# Modules are compiled, and their asserts rewritten, once for all processes, whatever the shell says of bytecode.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest --durations 15
# A test that stands still for five minutes fails, and says where it stood.
STANDSTILL := -o faulthandler_timeout=300 -o faulthandler_exit_on_timeout=true
test: environment
	$(PYTEST) $(AT_A_TIME) $(STANDSTILL) -p no:schemathesis -m 'not studies' -k 'not postgresql'

soak: kill-test load-test cluster-test postgresql-test method-test studies-test hostile-test schema-test

CYCLES ?= 200
POINTS ?= 0
kill-test: $(DEV)
	@command -v cc >/dev/null || { flock /tmp/isoshape-apt apt-get update -qq && \
		flock /tmp/isoshape-apt apt-get install -qq --no-install-recommends gcc libc6-dev >/dev/null; }
	CYCLES=$(CYCLES) POINTS=$(POINTS) SEED=$(SEED) $(PYTEST) tests/soak/kill -rfEP

cluster-test: $(DEV)
	$(PYTEST) tests/soak/cluster

postgresql-test: $(DEV)
	$(PYTEST) $(AT_A_TIME) -k postgresql tests/service

method-test: $(DEV)
	$(PYTEST) $(AT_A_TIME) tests/soak/method

studies-test: $(DEV)
	$(PYTEST) $(AT_A_TIME) -m studies tests/service
	$(PYTEST) tests/studies

collections-test: $(DEV)
	@test -d "$${ISOSHAPE_DATA:-}" || { echo 'ISOSHAPE_DATA must name the folder of collections' >&2; exit 1; }
	SAMPLE=$(SAMPLE) $(PYTEST) $(AT_A_TIME) tests/soak/collections -rfEP

COUNT ?= 10000
SEED ?= 0
hostile-test: $(DEV)
	COUNT=$(COUNT) SEED=$(SEED) $(PYTEST) $(AT_A_TIME) tests/soak/hostile -rfEP

schema-test: $(DEV)
	$(PYTEST) tests/soak/schema --hypothesis-seed=$(SEED)

MINUTES ?= 20
load-test: $(DEV)
	MINUTES=$(MINUTES) $(PYTEST) tests/soak/load -rfEP

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(DEV)
	$(BIN)/mypy --strict
	$(BIN)/mypy --strict docker/test/*.py

openapi: $(RUNTIME)
	$(BIN)/isoshape openapi

# The test lock holds the runtime lock's versions, so that what is tested is what runs.
lock: $(if $(filter $(BIN)/uv,$(UV)),$(DEV))
	$(COMPILE) pyproject.toml --extra views --output-file requirements.lock
	$(COMPILE) pyproject.toml --extra dev --extra views --constraint requirements.lock --output-file tests/requirements.lock
	$(COMPILE) pyproject.toml --extra browser --constraint tests/requirements.lock --output-file tests/soak/browser/requirements.lock
	$(COMPILE) pyproject.toml --extra postgres --extra dask --extra views --constraint requirements.lock --output-file docker/cluster.lock
	$(COMPILE) docker/test/requirements.in --constraint requirements.lock --output-file docker/test/requirements.lock
	$(COMPILE) tests/soak/supply/requirements.in --output-file tests/soak/supply/requirements.lock

# Hashes are left out of the comparison: a project may add a file to a release long after it. pip checks them at install.
lock-check: $(DEV)
	@scratch=$$(mktemp -d); trap 'rm -rf "$$scratch"' EXIT; \
	tar -c pyproject.toml docker/test/requirements.in tests/soak/supply/requirements.in $(LOCKS) | tar -x -C "$$scratch"; \
	$(MAKE) --silent --no-print-directory -C "$$scratch" -f "$(CURDIR)/Makefile" UV="$(CURDIR)/$(BIN)/uv" UPGRADE= lock; \
	for lock in $(LOCKS); do diff <(grep -F == $$lock) <(grep -F == "$$scratch/$$lock") || { \
		echo "$$lock is behind pyproject.toml: make lock" >&2; exit 1; }; done; \
	echo 'The lock files answer pyproject.toml.'

image-test: $(DEV)
	docker/image-test.sh
	docker/cluster-test.sh

$(NODE): tests/soak/page/package-lock.json
	cd tests/soak/page && npm ci --ignore-scripts --no-audit --no-fund --silent
	@touch $@

page-vendor: $(NODE)
	tests/soak/page/vendor.sh service/web/static/vendor

page-lint: $(NODE)
	cd tests/soak/page && node_modules/.bin/tsc --project .
	@scratch=$$(mktemp -d); trap 'rm -rf "$$scratch"' EXIT; tests/soak/page/vendor.sh "$$scratch"; \
	diff --recursive --brief --exclude=README.md --exclude=three.d.ts "$$scratch" service/web/static/vendor || { \
		echo 'the page has other files than its lock names: make page-vendor' >&2; exit 1; }

$(BROWSER): tests/soak/browser/requirements.lock $(DEV)
	$(PIP) install --require-hashes --requirement tests/soak/browser/requirements.lock
	@command -v chromium >/dev/null || { flock /tmp/isoshape-apt apt-get update -qq && \
		flock /tmp/isoshape-apt apt-get install -qq --no-install-recommends chromium fonts-dejavu-core >/dev/null; }
	@touch $@

browser-test: $(BROWSER)
	$(PYTEST) tests/soak/browser

screenshots: $(BROWSER)
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.soak.browser.screenshots docs

# Tools that examine the packages have an environment of their own.
$(SUPPLY)/.installed: tests/soak/supply/requirements.lock $(PACKAGES)
	$(BIN)/python -m venv --clear $(SUPPLY)
	$(SUPPLY)/bin/python -m pip -qq --disable-pip-version-check install --require-hashes --requirement $<
	@touch $@

sbom: $(SUPPLY)/.installed
	@mkdir -p build
	$(SUPPLY)/bin/python -W ignore -m cyclonedx_py requirements requirements.lock --pyproject pyproject.toml \
		--output-reproducible --output-file build/isoshape.cdx.json

audit: $(SUPPLY)/.installed $(DEV)
	$(PYTEST) tests/soak/supply
	@$(SUPPLY)/bin/python tests/soak/supply/audit.py requirements.lock

clean:
	rm -rf $(VENV) tests/soak/page/node_modules build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find core service tests docker -name __pycache__ -prune -exec rm -rf {} +
