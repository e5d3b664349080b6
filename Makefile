# The doors of the house for those who type make. Everything is set up by scripts/setup.sh, in .venv and web/node_modules.
OUT ?= out
SET_UP := bash scripts/setup.sh
PYTHON_HERE := .venv/bin/python

.PHONY: run test check lint types docs web web-test demo tour bench fenicsx sanitize clean

run:  ## the live simulator; it prints the address to open (ARGS="--port N")
	@./run $(ARGS)

test:  ## every test, lint and type check, and the docs
	@./test

check:  ## the everyday tests
	@./test quick

lint types docs:
	@./test $@

web:  ## the page of the simulator
	@$(SET_UP) page

web-test:
	@./test page

sanitize:  ## the core's tests on a build with AddressSanitizer and UBSan: one of the slow tests
	@./test slow -- tests/test_core_sanitized.py

demo:  ## push a needle into the generated phantom and say where the picture is
	@$(SET_UP) run
	$(PYTHON_HERE) -m sonospline insert --out $(OUT)

tour:  ## the screenshots of docs/tour.md, by the browser tests
	@$(SET_UP) dev page browser
	SONOSPLINE_SCREENSHOTS=docs/images/tour SONOSPLINE_REQUIRE_BROWSER=1 $(PYTHON_HERE) -m pytest tests/test_page_looks.py -k 'pictures or upright'

bench:  ## the claims that carry a time
	@$(SET_UP) dev
	for script in benchmarks/*.py; do $(PYTHON_HERE) $$script || exit 1; done

fenicsx:  ## the paper's finite element engine, for the system's Python (Debian, Ubuntu)
	@$(SET_UP) fenicsx

clean:
	rm -rf .venv build docs/_build web/node_modules src/sonospline/server/page
