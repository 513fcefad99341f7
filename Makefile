# Two verbs do everything on a fresh machine with Python 3.11+ and make: `make run` and `make test`.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
PARALLEL := --numprocesses auto --dist loadfile --no-loadscope-reorder
export MPLBACKEND := Agg

.DEFAULT_GOAL := help
.PHONY: help run test prove storms lint bench clean

help: ## show these verbs
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1|\2/' | column -t -s '|'

$(BIN)/clearcap: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable '.[excel]'
	@touch $@

$(VENV)/.dev: $(BIN)/clearcap
	$(BIN)/pip install --quiet --editable '.[dev]'
	@touch $@

run: $(BIN)/clearcap ## install, simulate 500 C-60 circuit breakers on this machine's cores, write the capability report
	$(BIN)/clearcap run c60 --samples 500 --store runs

test: $(VENV)/.dev ## prove the parts, one process a core
	$(BIN)/python -m pytest $(PARALLEL)

prove: $(VENV)/.dev ## the slow proofs: what fails while a campaign runs, scale, several hosts, a browser
	$(BIN)/python -m pytest -m "slow and not storm and not alone" $(PARALLEL)
	$(BIN)/python -m pytest -m alone

storms: $(VENV)/.dev ## twenty campaigns whose processes are killed at random (about 8 minutes on two cores)
	$(BIN)/python -m pytest -m storm --numprocesses auto

lint: $(VENV)/.dev ## style, types, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.dev ## measure: microseconds per step, friction solver, campaign efficiency
	$(BIN)/python -m benchmarks

clean: ## remove the environment and all caches, keep results
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache build *.egg-info
