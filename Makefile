# Everything runs in .venv, which the first target that needs it makes. Python 3.11 or newer and make
# are all that must be there.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
VENV_CUDA := .venv-cuda
READY_CUDA := $(VENV_CUDA)/.ready
CAPTURE ?=
OUT ?= demo
BENCHMARKS := commands frame passes renderers scaling memory author formats converters decimation \
	convert_memory deep colour simulation simulated_frame simulated_beginning live bakes preview_ui page_link minification \
	lod_build lod_quality lod_films split_table refinement normals lighting window_latency
GPU_BENCHMARKS := commands cuda_frame simulation_cuda cuda_scaling lod_cuda

CAPABILITIES := 8.0,9.0

.PHONY: demo test test-all test-cuda lint docs bench bench-gpu cover clean

demo: $(READY)
	$(BIN)/usdsplat demo $(CAPTURE) -o $(OUT)

# Kernels are compiled before, by all cores, so that no two tests compile the same. What one run
# compiled the next one loads.
test: $(READY)
	$(BIN)/usdsplat compile --device cpu
	$(BIN)/python -m pytest -n auto --dist worksteal

# What `test` leaves out: further seeds of what is random, whole matrices, long runs.
test-all: $(READY)
	$(BIN)/usdsplat compile --device cpu
	$(BIN)/python -m pytest -n auto --dist worksteal -m slow

# Every kernel for a GPU, assembled to machine code, which needs neither GPU nor driver. In an
# environment of its own: what compiles for CUDA takes 700 MB.
test-cuda: $(READY_CUDA)
	$(VENV_CUDA)/bin/usdsplat compile --device cuda --capability $(CAPABILITIES)
	USDSPLAT_REQUIRE_NUMBA_CUDA=1 $(VENV_CUDA)/bin/python -m pytest -n auto --dist worksteal \
		tests/kernels/cuda/test_compiling.py tests/kernels/cuda/test_compiling_passes.py \
		tests/kernels/cuda/test_exact.py

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The site, in build/site. The pages of reference/ are generated and committed; tests compare them.
docs: $(READY)
	$(BIN)/sphinx-build --fresh-env --fail-on-warning --keep-going --quiet docs build/site
	@echo "build/site/index.html"

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
	rm -rf $(VENV) $(VENV_CUDA) demo

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("usdsplat: found Python %d.%d, expected 3.11 or newer" % sys.version_info[:2] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $(READY)

$(READY_CUDA): pyproject.toml
	$(PYTHON) -m venv $(VENV_CUDA)
	$(VENV_CUDA)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,cuda]'
	touch $(READY_CUDA)
