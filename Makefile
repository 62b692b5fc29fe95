# `make demo` installs what running needs, `make test` what tests and tools need on top; `make setup` does both.
# Only Python 3.11 to 3.14 and a package index are needed. Packages are wheels, so that nothing is compiled. They
# are installed by uv, which is taken from the path or put into .venv, or by pip where it cannot be had.

VENV  := .venv
BIN   := $(VENV)/bin
RUNS  := $(VENV)/.runs
STAMP := $(VENV)/.installed

# Containers set it to stay small.  Without its bytecode every process compiles some 600 modules anew: 6 s.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup demo app test lint docs claims release-check clean

help:
	@echo "make setup   make .venv with the pinned dependencies and this package"
	@echo "make demo    diagnose a measured beam and a simulated stage, and fit a measured rock"
	@echo "make app     open the interactive page"
	@echo "make test    run the tests"
	@echo "make lint    check format, lint and types"
	@echo "make docs    build the documentation into build/site"
	@echo "make claims  repeat all measured figures, and say what no longer holds"
	@echo "make release-check   build what is released, and try it in a new environment"
	@echo "make clean   remove .venv and what the tools left behind"

setup: $(STAMP)

# Both stamps are made last, so that what was interrupted never looks whole.
INSTALL = install="$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input"; \
	if command -v uv >/dev/null; then \
	  install="uv pip install --quiet --python $(BIN)/python"; \
	elif [ -x $(BIN)/uv ] || $$install --require-hashes -r requirements-uv.lock 2>/dev/null; then \
	  install="$(BIN)/uv pip install --quiet --python $(BIN)/python"; \
	else \
	  echo "make: no uv here, so pip installs the packages, which takes some minutes" >&2; \
	fi; \
	failed() { echo "make: $(VENV) is not complete, for the reason above; then run make again" >&2; exit 1; }

$(RUNS): requirements-run.lock pyproject.toml
	@python=; \
	for candidate in $(or $(PYTHON),python3 python3.13 python3.12 python3.11 python3.14 python); do \
	  if $$candidate -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' >/dev/null 2>&1; then \
	    python=$$candidate; break; \
	  fi; \
	done; \
	if [ -z "$$python" ]; then \
	  echo "make: $(if $(PYTHON),$(PYTHON) is no Python 3.11 to 3.14,no Python 3.11 to 3.14 found); install one, or name it: make PYTHON=/path/to/python3" >&2; \
	  exit 1; \
	fi; \
	if ! $$python -c 'import ensurepip, venv' >/dev/null 2>&1; then \
	  echo "make: $$python cannot make virtual environments; install its venv module (Debian, Ubuntu: python3-venv)" >&2; \
	  exit 1; \
	fi; \
	rm -f $(RUNS) $(STAMP); \
	$$python -m venv --clear $(VENV) || { echo "make: $(VENV) cannot be made, for the reason above" >&2; exit 1; }; \
	$(INSTALL); \
	$$install --only-binary :all: --require-hashes -r requirements-run.lock || failed; \
	$$install --no-deps --no-build-isolation --editable . || failed; \
	touch $(RUNS)

$(STAMP): $(RUNS) requirements.lock
	@rm -f $(STAMP); \
	$(INSTALL); \
	$$install --only-binary :all: --require-hashes -r requirements.lock || failed; \
	touch $(STAMP)

demo: $(RUNS)
	$(BIN)/preisach demo

app: $(STAMP)
	$(BIN)/preisach app

test: $(STAMP)
	$(BIN)/python -m pytest -n logical --maxprocesses 8 --dist worksteal

lint: $(STAMP)
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/pyright

docs: $(STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet --site-dir build/site

claims: $(STAMP)
	$(BIN)/python benchmarks/claims.py --run

release-check: $(STAMP)
	$(BIN)/python benchmarks/release.py

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis .jax_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
