# Two commands: `make demo` and `make test`. Both bring the machine to the state they need (`make setup`) first.
VENV ?= .venv
STAMP := $(VENV)/.installed
RUN := $(VENV)/bin/
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: setup demo demo-service images test test-all bench lint
setup: $(STAMP)
$(STAMP): pyproject.toml constraints.txt setup.sh
	bash setup.sh $(VENV)
	@touch $@

demo: setup            ## one actor, from images to avatar and gap report
	$(RUN)physavatar demo

# PostgreSQL where it answers (DATABASE=postgresql+asyncpg://… names another), else SQLite; PORT of the UI
PORT ?= 4200
DATABASE ?= $(shell psql -wqtAc 'select' -h 127.0.0.1 -U postgres postgres >/dev/null 2>&1 && echo postgresql+asyncpg://postgres@127.0.0.1:5432/physavatar)
demo-service: setup    ## server, workers and two actors, on this machine; prints the UI's address, Ctrl-C ends it
	$(if $(DATABASE),PHYSAVATAR_SERVICE__DATABASE="$(DATABASE)") $(RUN)physavatar up --demo --port $(PORT)

images: setup          ## one container image per kind of worker, with docker or buildah
	bash containers/build.sh

test: setup            ## everything but what carries the marker `slow`, on up to four cores
	$(RUN)python -m pytest -m "not slow" -n logical --maxprocesses 4 --dist loadfile

test-all: setup
	$(RUN)python -m pytest

bench: setup           ## make bench NAME=simulator [JSON=1] [QUICK=1]
	$(RUN)python -m tests.benchmarks.$(NAME)

lint: setup
	$(RUN)ruff check . && $(RUN)ruff format --check . && $(RUN)lint-imports && $(RUN)basedpyright --pythonpath $(RUN)python
