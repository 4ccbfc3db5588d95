# Needs Python 3.11 or later and nothing else: everything is installed into .venv.

PYTHON ?= python3
BIN = .venv/bin

# `make test ENGINES=all` takes every engine that has wheels, dask and proofs; without it, those of any installation.
ENGINES ?=
ifneq ($(ENGINES),$(filter all,$(ENGINES)))
$(error ENGINES=$(ENGINES): expected all, or nothing)
endif
EXTRAS = test,docs$(ENGINES:all=,mujoco,drake,dart,newton,fmi,dask,proof)
# one stamp for each: the environment is cleared with what the other had
SET_UP = .venv/set-up$(ENGINES:%=-%)

.PHONY: validate validate-quick validate-full bench bench-engines lint test clean

# Some minutes on two cores.
validate: $(SET_UP)
	$(BIN)/stiction validate

# A smoke test.
validate-quick: $(SET_UP)
	$(BIN)/stiction validate --quick

# Fine steps, long drift, every hard case: for a night.
validate-full: $(SET_UP)
	$(BIN)/stiction validate --full

# What runs of the reference cost beside their stepping, the table of the page on cost; some seconds.
bench: $(SET_UP)
	$(BIN)/python -m stiction.comparisons.sweep.run_costs

# What a step of every engine costs, the table of their pages; two minutes or so with nothing else running.
bench-engines: $(SET_UP)
	$(BIN)/python -m stiction.comparisons.measures.engine_costs

# Rules of the code's form, types and imports, in pyproject.toml; half a minute, a few seconds after the first time.
# `ruff format .` and `ruff check --fix .` mend most of what they find.
lint: $(SET_UP)
	$(BIN)/python -m ruff format --check .
	$(BIN)/python -m ruff check .
	PATH="$(CURDIR)/$(BIN):$$PATH" .ci/types

# On all cores, each worker with the kernels loaded, 0.6 GB. Bytecode is kept whatever the environment says: some hundred processes read it.
test: export PYTHONDONTWRITEBYTECODE =
test: $(SET_UP)
	$(BIN)/python -m pytest -n logical --maxprocesses 8 --dist worksteal --durations 25

$(SET_UP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "Python %d.%d: expected 3.11 or later; try make PYTHON=python3.12" % sys.version_info[:2])'
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS)]'
	touch $@

clean:
	rm -rf .venv build *.egg-info .pytest_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
