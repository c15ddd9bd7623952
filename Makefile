# Everything runs in .venv, which the first target that needs it makes. Python 3.11 or newer and make
# are all that must be there.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
CAPTURE ?=
OUT ?= demo

.PHONY: demo test lint bench cover clean

demo: $(READY)
	$(BIN)/usdsplat demo $(CAPTURE) -o $(OUT)

test: $(READY)
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

cover: $(READY)
	$(BIN)/python -m pytest --cov --cov-report=term-missing:skip-covered --cov-fail-under=90

bench: $(READY)
	$(BIN)/python -m benchmarks.frame
	$(BIN)/python -m benchmarks.memory
	$(BIN)/python -m benchmarks.author
	$(BIN)/python -m benchmarks.formats
	$(BIN)/python -m benchmarks.converters
	$(BIN)/python -m benchmarks.decimation
	$(BIN)/python -m benchmarks.convert_memory
	$(BIN)/python -m benchmarks.deep
	$(BIN)/python -m benchmarks.passes
	$(BIN)/python -m benchmarks.colour
	$(BIN)/python -m benchmarks.simulation
	$(BIN)/python -m benchmarks.simulated_frame
	$(BIN)/python -m benchmarks.bakes
	$(BIN)/python -m benchmarks.preview --million
	$(BIN)/python -m benchmarks.preview_ui

clean:
	rm -rf $(VENV) demo

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("usdsplat: found Python %d.%d, expected 3.11 or newer" % sys.version_info[:2] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $(READY)
