# Two verbs do everything on a fresh machine with Python 3.11+ and make: `make run` and `make test`.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
TOOLS  := build/tools/bin
LOCK   := deploy/requirements.lock
# The same versions without hashes, and those of the tools: a new release of one breaks no verb, and refuses no change.
DEV    := deploy/development.lock
AUDIT  := deploy/audit.lock
# The ends of what pyproject.toml allows: versions of Python, or paths to one
OLDEST ?= 3.11
NEWEST ?= 3.13
# Wheels with compiled kernels are for one Python each
RELEASED := 3.11 3.12 3.13
PYTHONS ?= $(PYTHON)
EXTRAS := cad client excel jobqueue kubernetes pdf s3 tls web xarray
# Each process of the tests has a core; OpenBLAS's threads would wait for one another, in twice the processor time.
TOGETHER := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest
# A process that crashes ends the run: pytest-xdist 3.8 waits for ever for the tests that it was given.
PARALLEL := --numprocesses auto --max-worker-restart 0 --dist loadfile --no-loadscope-reorder
# The slow tests wait for more than half of their time, for heartbeats, kills and browsers: two processes a core.
CORES  := $(shell nproc 2>/dev/null || getconf _NPROCESSORS_ONLN)
CROWD  := --numprocesses $(shell expr $(CORES) \* 2)
export MPLBACKEND := Agg
# The tests start some hundred processes: each would compile all modules again where nobody keeps bytecode.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help run serve docs test gate full everything on-s3 kernels storms attacks lint audit oldest newest lock wheel release bench clean

help: ## show these verbs
	@grep -hE '^[a-z0-9-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9-]+):.*## (.*)/  make \1|\2/' | column -t -s '|'

$(BIN)/clearcap: pyproject.toml $(DEV)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --constraint $(DEV) --editable '.[excel]'
	@touch $@

# uv takes seconds where pip takes minutes; where it does not reach the packages, for it does not read pip's settings, pip.
$(VENV)/.dev: pyproject.toml $(DEV) $(TOOLS)/uv
	test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV)
	$(TOOLS)/uv pip install --quiet --python $(BIN)/python --constraint $(DEV) --editable '.[dev]' || \
		$(BIN)/pip install --quiet --constraint $(DEV) --editable '.[dev]'
	@touch $(BIN)/clearcap $@

# They are no part of the environment: what they need must not change what clearcap runs with.
$(TOOLS)/uv: $(AUDIT)
	$(PYTHON) -m venv build/tools
	$(TOOLS)/pip install --quiet --requirement $(AUDIT)
	@touch $@

run: $(BIN)/clearcap ## install, simulate 500 C-60 circuit breakers on this machine's cores, write the capability report
	$(BIN)/clearcap run c60 --samples 500 --store runs
	@printf '\nTo go on, type:\n\n  source $(VENV)/bin/activate\n  clearcap simulate c60 --set J1=0.05\n\n'

serve: $(BIN)/clearcap ## pages and an API on this machine, computing 500 C-60; prints a link by which you log in
	$(BIN)/pip install --quiet --constraint $(DEV) --editable '.[excel,web]'
	$(BIN)/clearcap submit c60 --samples 500 --batch-size 25 --queue-only --store runs
	$(BIN)/clearcap serve --store runs

docs: $(VENV)/.dev ## the documentation as a site with search, in clearcap/web/pages/documentation; a server shows it under Help
	$(BIN)/python docs/build_site.py

test: $(VENV)/.dev ## prove the parts: what depends neither on the speed nor on the kind of the processor
	$(TOGETHER) $(PARALLEL)

gate: $(VENV)/.dev ## the quick tests that start processes, and one slow proof of each kind: storm, browser, README, S3, TLS
	$(TOGETHER) -m "processes and not slow or gate" $(PARALLEL) $(CROWD)

full: lint audit everything on-s3 kernels oldest newest ## all there is, with new seeds, before an issue is closed: three quarters of an hour

everything: $(VENV)/.dev
	$(TOGETHER) -m "" $(PARALLEL) $(CROWD)

on-s3: $(VENV)/.dev
	CLEARCAP_STORE_OF_TESTS=s3 $(TOGETHER) tests/clearcap/web -k s3 $(PARALLEL)

# A processor without AVX-512 cannot run the kernels of SkylakeX.
kernels: $(VENV)/.dev
	for kind in Haswell Zen $(shell grep -qs avx512f /proc/cpuinfo && echo SkylakeX); do \
		OPENBLAS_CORETYPE=$$kind $(TOGETHER) -m bits $(PARALLEL) || exit 1; done

everything on-s3: export CLEARCAP_FRESH := 1
everything on-s3: export CLEARCAP_STORMS ?= $(shell date +%s)
everything on-s3: export CLEARCAP_SECURITY_SEED ?= $(shell date +%s)

storms: $(VENV)/.dev ## a hundred campaigns that are killed, paused and robbed of their disk (about an hour on two cores)
	$(BIN)/python -m pytest tests/campaign/storms/test_storms.py -m storm --max-worker-restart 0 $(CROWD)

attacks: $(VENV)/.dev ## thousands of odd files and arrays, others each time
	CLEARCAP_SECURITY_SEED=$$(date +%s) $(TOGETHER) tests/security -m "not storm" $(PARALLEL)

lint: $(VENV)/.dev ## style, types, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

audit: $(TOOLS)/uv ## the locked packages: installable with these hashes, without known faults; their list in build/sbom.json
	$(TOOLS)/uv pip install --quiet --dry-run --python $(TOOLS)/python --require-hashes --requirement $(LOCK)
	$(TOOLS)/cyclonedx-py requirements $(LOCK) --pyproject pyproject.toml --output-reproducible --output-file build/sbom.json
	$(TOOLS)/python deploy/audit.py

# From nothing each time, because uv keeps versions that are there. The newest ones are not those of the lock file.
oldest newest: $(TOOLS)/uv
	$(TOOLS)/uv venv --quiet --clear --python $(PYTHON_OF) build/$@
	$(TOOLS)/uv pip install --quiet --python build/$@/bin/python --resolution $(RESOLUTION) \
		--requirements pyproject.toml $(EXTRAS:%=--extra %) --editable .
	build/$@/bin/python deploy/smoke.py

oldest: PYTHON_OF = $(OLDEST)
oldest: RESOLUTION = lowest-direct
oldest: ## import, two kernels, a small campaign and its report with the oldest packages that pyproject.toml allows
newest: PYTHON_OF = $(NEWEST)
newest: RESOLUTION = highest
newest: ## the same with the newest packages that it allows

COMPILE := $(TOOLS)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --custom-compile-command 'make lock'
lock: $(TOOLS)/uv ## lock the newest versions of all packages: those that a cluster needs, with their hashes; those of the tools
	$(COMPILE) --generate-hashes $(EXTRAS:%=--extra %) --output-file $(LOCK) pyproject.toml deploy/requirements.in
	$(COMPILE) --no-annotate --extra dev --constraint $(LOCK) --output-file $(DEV) pyproject.toml
	$(COMPILE) --no-annotate --output-file $(AUDIT) deploy/audit.in

wheel: $(TOOLS)/uv ## into dist/: source distribution, plain wheel, one with compiled kernels for this Python, or PYTHONS="3.11 3.12"
	rm -rf dist
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(TOOLS)/uv build --quiet --out-dir dist
	for python in $(PYTHONS); do \
		$(TOOLS)/uv venv --quiet --clear --python $$python build/wheel && \
		$(TOOLS)/uv pip install --quiet --python build/wheel/bin/python --constraint $(DEV) dist/*-none-any.whl && \
		build/wheel/bin/python deploy/compiled_wheel.py dist/*-none-any.whl || exit 1; done

release: $(TOOLS)/uv ## VERSION=1.2.3: set it, write the notes, build wheels, source distribution and list of packages into dist/
	test -n "$(VERSION)"
	$(TOOLS)/uv version --quiet --frozen "$(VERSION)"
	$(TOOLS)/towncrier build --yes --version "$(VERSION)"
	$(MAKE) wheel PYTHONS="$(RELEASED)"
	$(TOOLS)/cyclonedx-py requirements $(LOCK) --pyproject pyproject.toml --output-reproducible --output-file dist/clearcap-$(VERSION).sbom.json
	@ls -l dist; printf '\nRead CHANGELOG.md, then: git commit --all --message "clearcap $(VERSION)" && git tag v$(VERSION)\n'

bench: $(VENV)/.dev ## measure: microseconds per step, friction solver, campaign efficiency
	$(BIN)/python -m benchmarks

clean: ## remove the environment and all caches, keep results
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache build dist *.egg-info
