# Everything runs in .venv, which the first target that needs it makes. Python 3.11 or newer and make
# are all that must be there.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
CAPTURE ?=
OUT ?= demo
BENCHMARKS := frame passes renderers scaling memory author formats converters decimation \
	convert_memory deep colour simulation simulated_frame bakes preview_ui
GPU_BENCHMARKS := cuda_frame simulation_cuda cuda_scaling

.PHONY: demo test lint bench bench-gpu cover clean

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

# Measured alone, one after the other; each takes `--json FILE` too. Peers stand beside ours where
# `python -m benchmarks.peers` has installed them.
bench: $(READY)
	set -e; for name in $(BENCHMARKS); do $(BIN)/python -m benchmarks.$$name; done
	$(BIN)/python -m benchmarks.preview --million

bench-gpu: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[cuda]'
	set -e; for name in $(GPU_BENCHMARKS); do $(BIN)/python -m benchmarks.$$name; done

clean:
	rm -rf $(VENV) demo

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("usdsplat: found Python %d.%d, expected 3.11 or newer" % sys.version_info[:2] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $(READY)
