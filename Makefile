# Two verbs do everything on a fresh machine with Python 3.11+ and make: `make run` and `make test`.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
TOOLS  := build/tools/bin
LOCK   := deploy/requirements.lock
# The ends of what pyproject.toml allows: versions of Python, or paths to one
OLDEST ?= 3.11
NEWEST ?= 3.13
EXTRAS := cad client excel jobqueue kubernetes pdf s3 tls web
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
.PHONY: help run serve test prove storms service-on-s3 attacks lint audit oldest newest lock bench clean

help: ## show these verbs
	@grep -hE '^[a-z0-9-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9-]+):.*## (.*)/  make \1|\2/' | column -t -s '|'

# The versions of the lock file, which CI has tested: a new release of a library cannot break these two verbs.
$(BIN)/clearcap: pyproject.toml $(LOCK)
	$(PYTHON) -m venv $(VENV)
	grep -E '^[a-z0-9]' $(LOCK) | sed 's/ *\\$$//' > $(VENV)/versions.txt
	$(BIN)/pip install --quiet --constraint $(VENV)/versions.txt --editable '.[excel]'
	@touch $@

$(VENV)/.dev: $(BIN)/clearcap
	$(BIN)/pip install --quiet --constraint $(VENV)/versions.txt --editable '.[dev]'
	@touch $@

# They are no part of the environment: what they need must not change what clearcap runs with.
$(TOOLS)/uv:
	$(PYTHON) -m venv build/tools
	$(TOOLS)/pip install --quiet uv pip-audit cyclonedx-bom
	@touch $@

run: $(BIN)/clearcap ## install, simulate 500 C-60 circuit breakers on this machine's cores, write the capability report
	$(BIN)/clearcap run c60 --samples 500 --store runs
	@printf '\nTo go on, type:\n\n  source $(VENV)/bin/activate\n  clearcap simulate c60 --set J1=0.05\n\n'

serve: $(BIN)/clearcap ## pages and an API on this machine, computing 500 C-60; prints a link by which you log in
	$(BIN)/pip install --quiet --constraint $(VENV)/versions.txt --editable '.[excel,web]'
	$(BIN)/clearcap submit c60 --samples 500 --batch-size 25 --queue-only --store runs
	$(BIN)/clearcap serve --store runs

test: $(VENV)/.dev ## prove the parts, one process a core
	$(TOGETHER) $(PARALLEL)

prove: $(VENV)/.dev ## the slow proofs: what fails while a campaign runs, scale, several hosts, a browser, six of the storms
	CLEARCAP_STORMS=$${CLEARCAP_STORMS:-1} $(TOGETHER) -m "slow and not alone" $(PARALLEL) $(CROWD)
	$(BIN)/python -m pytest tests/campaign/storms -m alone

storms: $(VENV)/.dev ## a hundred campaigns that are killed, paused and robbed of their disk (about an hour on two cores)
	$(BIN)/python -m pytest tests/campaign/storms/test_storms.py -m storm --max-worker-restart 0 $(CROWD)

service-on-s3: $(VENV)/.dev ## the tests of the service with their stores on S3
	CLEARCAP_STORE_OF_TESTS=s3 $(TOGETHER) tests/campaign/web -k s3 $(PARALLEL)

attacks: $(VENV)/.dev ## thousands of odd files and arrays, others each time
	$(TOGETHER) tests/security -m "not storm and not alone" $(PARALLEL)

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

lock: $(TOOLS)/uv ## lock the newest versions of all packages that a cluster needs, with their hashes
	$(TOOLS)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes \
		$(EXTRAS:%=--extra %) --custom-compile-command 'make lock' --output-file $(LOCK) pyproject.toml deploy/requirements.in

bench: $(VENV)/.dev ## measure: microseconds per step, friction solver, campaign efficiency
	$(BIN)/python -m benchmarks

clean: ## remove the environment and all caches, keep results
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache build *.egg-info
