# Two commands: `make demo` and `make test`. Both bring the machine to the state they need (`make setup`) first.
VENV ?= .venv
STAMP := $(VENV)/.installed
RUN := $(VENV)/bin/
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: setup demo test test-all bench lint
setup: $(STAMP)
$(STAMP): pyproject.toml constraints.txt setup.sh
	bash setup.sh $(VENV)
	@touch $@

demo: setup            ## one actor, from images to avatar and gap report
	$(RUN)physavatar demo

test: setup            ## everything but what carries the marker `slow`
	$(RUN)python -m pytest -m "not slow"

test-all: setup
	$(RUN)python -m pytest

bench: setup           ## make bench NAME=simulator [JSON=1] [QUICK=1]
	$(RUN)python -m tests.benchmarks.$(NAME)

lint: setup
	$(RUN)ruff check . && $(RUN)ruff format --check . && $(RUN)lint-imports
