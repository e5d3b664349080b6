# Everything happens in .venv; nothing else on the machine is touched.
PYTHON ?= python3
OUT ?= out
BIN := .venv/bin
SOURCES := pyproject.toml constraints.txt CMakeLists.txt $(wildcard src/sonospline/_core/src/*)
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: run test lint types check docs bench fenicsx clean

run: .venv/run.stamp  ## push a needle into the generated phantom and say where the picture is
	$(BIN)/sonospline insert --out $(OUT)

test: lint types docs .venv/dev.stamp  ## everything CI runs
	$(BIN)/pytest -n 2

lint: .venv/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/dev.stamp
	$(BIN)/mypy

check: .venv/dev.stamp
	$(BIN)/pytest -n 2 -m "not slow"

docs: .venv/dev.stamp
	$(BIN)/sphinx-build -W --keep-going -q docs docs/_build

bench: .venv/dev.stamp  ## the claims that carry a time
	for script in benchmarks/*.py; do $(BIN)/python $$script || exit 1; done

SUDO = $(shell test "$$(id -u)" = 0 || echo sudo)

fenicsx:  ## the paper's finite element engine, for the system's Python (Debian, Ubuntu); OpenBLAS makes its solver fast
	$(SUDO) apt-get update -qq
	$(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends python3-dolfinx-real libopenblas0-pthread
	/usr/bin/python3 -c 'import dolfinx; print("DOLFINx", dolfinx.__version__)'

.venv/pip.stamp:
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet pip
	touch $@

.venv/run.stamp: .venv/pip.stamp $(SOURCES)
	$(BIN)/pip install --quiet --editable '.[all]'
	$(BIN)/sonospline doctor
	touch $@

.venv/dev.stamp: .venv/run.stamp
	$(BIN)/pip install --quiet --group test --group lint --group docs
	touch $@

clean:
	rm -rf .venv build docs/_build $(OUT)
