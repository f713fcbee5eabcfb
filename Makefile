# Names for commands. All set-up happens in .venv/ and target/ of this folder.
#
#   make run      set up, run the 14-body vehicle over its bump, write the report
#   make test     checks, Rust tests, Python tests
#   make verify   tests with debug assertions, and the long figures
#   make bench    kernel benchmarks and the questions of benchmarks/
#   make viewer   rebuild the 3-D page from viewer/; needs node
#   make docs     regenerate the pages and pictures that are derived from the code
#   make clean    remove everything that was built
#
# `make run PYTHON=/path/to/python3` chooses the interpreter.

PYTHON ?=
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.built
SOURCES := pyproject.toml constraints.txt Cargo.toml Cargo.lock tools/preflight.sh \
           $(wildcard crates/*/Cargo.toml) $(shell find crates/*/src -type f)

export PYO3_PYTHON := $(CURDIR)/$(BIN)/python
export CARGO_TARGET_DIR := $(CURDIR)/target
export MPLBACKEND := Agg

.PHONY: run setup test check format verify bench docs viewer wheel clean

run: setup
	$(BIN)/holonom run models/hmmwv14/model.toml -o results/hmmwv14.holonom
	$(BIN)/holonom report results/hmmwv14.holonom

setup: $(STAMP)

# One stamp over manifests and sources: when nothing changed, nothing is started. Python sources
# need no step, because the package is installed in place.
$(STAMP): $(SOURCES)
	@tools/preflight.sh '$(PYTHON)' $(VENV)
	@echo 'setting up: Python packages'
	@$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt maturin
	@echo 'setting up: the engine, an optimized build (about two minutes the first time)'
	@PIP_CONSTRAINT=constraints.txt PIP_QUIET=1 PIP_DISABLE_PIP_VERSION_CHECK=1 VIRTUAL_ENV=$(CURDIR)/$(VENV) \
	    $(BIN)/maturin develop --release --extras plot,render,xarray,parquet,netcdf,matlab,dev --quiet
	@touch $@

# Everything is built with one profile, so that nothing is built twice; `verify` runs the tests with debug
# assertions, too.
test: check
	cargo test --workspace --release --quiet
	$(BIN)/pytest --quiet --numprocesses auto

check: setup
	cargo fmt --all --check
	$(BIN)/ruff format --check python examples
	$(BIN)/ruff check python examples
	$(BIN)/mypy
	cargo clippy --workspace --release --all-targets --quiet -- -D warnings
	RUSTDOCFLAGS='-D warnings' cargo doc --workspace --release --no-deps --quiet

format: setup
	cargo fmt --all
	$(BIN)/ruff check --fix python examples
	$(BIN)/ruff format python examples

verify: setup
	cargo test --workspace
	cargo test --workspace --release --features holonom/long
	HOLONOM_BROWSER=required $(BIN)/pytest -m 'long or browser'

bench: setup
	cargo bench --workspace
	for question in benchmarks/*/run.py; do $(BIN)/python "$$question" || exit 1; done

docs: run
	$(BIN)/holonom schema --reference > docs/model-file.md
	$(BIN)/holonom plot results/hmmwv14.holonom 'chassis.position[2]' 'chassis.yaw_pitch_roll[1]' \
	    -o docs/images/hmmwv14.svg
	for example in examples/[0-9]*.py; do $(BIN)/python "$$example" || exit 1; done

viewer:
	cd viewer && npm install --no-package-lock --no-audit --no-fund && npm run build

wheel: setup
	$(BIN)/maturin build --release --out dist

clean:
	rm -rf $(VENV) target results dist build .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find python crates -name __pycache__ -prune -exec rm -rf {} +
	rm -f python/holonom/_core*.so
