# `make reproduce` and `make test` first bring .venv up to environment.txt; the stamp is written only after success.
PYTHON ?= python3
export PATH := $(CURDIR)/.venv/bin:$(PATH)
unexport PYTHONDONTWRITEBYTECODE # or each of some hundred processes would compile all that it imports

.PHONY: install reproduce test bench bench-large site lite notebooks lock clean

install: .venv/installed
	@echo "Installed; . .venv/bin/activate makes the command profilecal"

reproduce: .venv/installed
	@profilecal reproduce

test: .venv/installed
	@ruff check . && ruff format --check .
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 PYTHONPATH=tests pytest -p quick_start \
	    -p xdist -n auto --dist loadfile --no-loadscope-reorder -p nbval --nbval --nbval-current-env --nbval-cell-timeout=600 \
	    notebooks tests # the long ones first

bench: .venv/installed # CPU time against peers and plain loops; writes results/bench.csv
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/run.py

bench-large: .venv/installed # scans of up to 100,000 profiles: some minutes
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/run.py large

site: .venv/installed # the notebooks as they are committed, README, reference; results/site/html
	@{ command -v uv >/dev/null && uv pip install -q --python .venv/bin/python -e ".[site]" || .venv/bin/pip install -q -e ".[site]"; }
	@OMP_NUM_THREADS=1 python docs/assemble.py results/site/source
	@sphinx-build -q -W --keep-going -j auto results/site/source results/site/html
	@echo "Open results/site/html/index.html"

lite: .venv/installed # the pages for the Python of a browser, which fetches it from its publisher; results/lite/html
	@{ command -v uv >/dev/null && uv pip install -q --python .venv/bin/python -e ".[lite]" || .venv/bin/pip install -q -e ".[lite]"; }
	@rm -rf results/lite
	@{ command -v uv >/dev/null && uv build -q --wheel -o results/lite . || .venv/bin/pip wheel -q --no-deps -w results/lite .; }
	@python docs/lite.py results/lite/files
	@cd results/lite && jupyter lite build --contents files --piplite-wheels *.whl --output-dir html >build.log 2>&1 || { cat build.log; exit 1; }
	@echo "python -m http.server -d results/lite/html, then http://localhost:8000/lab/?path=notebooks/60_calibrate_your_scanner.ipynb"

notebooks: .venv/installed # execute the committed notebooks in place, keeping only the metadata that matters
	@jupyter nbconvert --log-level=WARN --to notebook --execute --inplace --ExecutePreprocessor.record_timing=False \
	    --ClearMetadataPreprocessor.enabled=True --ClearMetadataPreprocessor.preserve_cell_metadata_mask=tags \
	    --ClearMetadataPreprocessor.preserve_cell_metadata_mask=jupyter \
	    --ClearMetadataPreprocessor.preserve_cell_metadata_mask=alt \
	    --ClearMetadataPreprocessor.preserve_nb_metadata_mask=kernelspec \
	    $(sort $(filter-out notebooks/00_%,$(wildcard notebooks/*.ipynb))) $(wildcard notebooks/00_*.ipynb)

lock: .venv/installed # the newest version of everything, pinned
	@{ echo "# Every version pinned, by \`make lock\`. Works with plain pip: pip install -r environment.txt" && \
	   uv pip compile -q --universal --python-version 3.11 --upgrade --no-header --no-annotate \
	     --extra notebooks --extra test pyproject.toml && echo "-e ." ; } > environment.new && mv environment.new environment.txt

clean:
	rm -rf .venv results

.venv/installed: environment.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  { echo "profilecal needs Python 3.11 or newer. Say where it is: make PYTHON=python3.13 $(MAKECMDGOALS)"; exit 1; }
	@echo "Installing environment.txt into .venv (once; one to three minutes)"
	@rm -rf .venv
	@if command -v uv >/dev/null; then uv venv -q --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" .venv; \
	elif $(PYTHON) -c 'import ensurepip' 2>/dev/null; then \
	  $(PYTHON) -m venv .venv && { .venv/bin/pip install -q uv || echo "No uv to be had: pip installs, in about two minutes."; }; \
	else echo "Python's venv module is incomplete here. On Debian and Ubuntu: sudo apt install python3-venv"; exit 1; fi
	@if command -v uv >/dev/null; then uv pip install -q --python .venv/bin/python -r environment.txt; \
	else .venv/bin/pip install -q --no-compile -r environment.txt; fi
	@touch $@
