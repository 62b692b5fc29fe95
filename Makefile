# `make demo` and `make test` set up everything they need; `make setup` alone does just that.
# Only Python 3.11 or newer and a package index are needed. Packages are installed by uv, which is taken from
# the path or put into .venv, or by pip where it cannot be had.

VENV  := .venv
BIN   := $(VENV)/bin
STAMP := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help setup demo app test lint docs claims clean

help:
	@echo "make setup   make .venv with the pinned dependencies and this package"
	@echo "make demo    diagnose the bundled measurement and a simulated stage"
	@echo "make app     open the interactive page"
	@echo "make test    run the tests"
	@echo "make lint    check format, lint and types"
	@echo "make docs    build the documentation into build/site"
	@echo "make claims  repeat all measured figures, and say what no longer holds"
	@echo "make clean   remove .venv and what the tools left behind"

setup: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	@set -e; \
	python=; \
	for candidate in $(PYTHON) python3 python3.13 python3.12 python3.11 python3.14 python; do \
	  if $$candidate -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	    python=$$candidate; break; \
	  fi; \
	done; \
	if [ -z "$$python" ]; then \
	  echo "make: no Python 3.11 or newer found; install one, or name it: make PYTHON=/path/to/python3" >&2; \
	  exit 1; \
	fi; \
	if ! $$python -c 'import ensurepip, venv' >/dev/null 2>&1; then \
	  echo "make: $$python cannot make virtual environments; install its venv module (Debian, Ubuntu: python3-venv)" >&2; \
	  exit 1; \
	fi; \
	rm -f $(STAMP); \
	$$python -m venv --clear $(VENV); \
	install="$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input"; \
	if command -v uv >/dev/null; then \
	  install="uv pip install --quiet --python $(BIN)/python"; \
	elif $$install --require-hashes -r requirements-uv.lock 2>/dev/null; then \
	  install="$(BIN)/uv pip install --quiet --python $(BIN)/python"; \
	else \
	  echo "make: no uv here, so pip installs the packages, which takes some minutes" >&2; \
	fi; \
	$$install --require-hashes -r requirements.lock; \
	$$install --no-deps --no-build-isolation --editable .; \
	touch $(STAMP)

demo: $(STAMP)
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

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis .jax_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
