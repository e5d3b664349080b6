# Everything happens in .venv; nothing else on the machine is touched.
PYTHON ?= python3
OUT ?= out
BIN := .venv/bin
SOURCES := pyproject.toml constraints.txt CMakeLists.txt $(wildcard src/sonospline/_core/src/*)
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# The page of the simulator, built into the package; without npm the server says what is missing.
PAGE := src/sonospline/simulator/page/index.html
PAGE_SOURCES := $(wildcard web/*.json web/*.ts web/*.html web/src/* web/src/*/*)

.PHONY: run demo test web web-test lint types check docs bench tour fenicsx clean

run: .venv/run.stamp web  ## the live simulator; it prints the address to open
	$(BIN)/sonospline serve

demo: .venv/run.stamp  ## push a needle into the generated phantom and say where the picture is
	$(BIN)/sonospline insert --out $(OUT)

test: lint types docs web web-test .venv/dev.stamp  ## everything CI runs
	$(BIN)/pytest -n 2

ifneq ($(shell command -v npm),)
web: $(PAGE)  ## the page, where npm is at hand

web-test: web/node_modules/.stamp
	cd web && npm run --silent types && npm run --silent test
else
web web-test:
	@echo "npm was not found: the page is not built or tested here (Debian, Ubuntu: apt install npm)" >&2
endif

web/node_modules/.stamp: web/package.json
	cd web && npm install --silent --no-audit --no-fund
	touch $@

$(PAGE): web/node_modules/.stamp $(PAGE_SOURCES)
	cd web && npm run --silent build -- --logLevel warn
	touch $@

tour: .venv/dev.stamp web  ## the screenshots of docs/tour.md, by the browser tests
	SONOSPLINE_SCREENSHOTS=docs/images/tour SONOSPLINE_REQUIRE_BROWSER=1 $(BIN)/pytest tests/test_page_looks.py -k pictures

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
	rm -rf .venv build docs/_build web/node_modules src/sonospline/simulator/page $(OUT)
