# `make demo` sets up and runs the main job, `make test` sets up and runs the tests.
PYTHON ?= python3
VENV ?= .venv
export SMSID_DATA ?= $(wildcard $(abspath ../shared/data))
export SMSID_ORACLE ?= $(wildcard $(abspath ../shared/oracle))
# small matrices: BLAS threads only get in each other's way
export OPENBLAS_NUM_THREADS ?= 1
JOBS ?= 2

.PHONY: demo test test-slow lint docs clean

demo: $(VENV)/.demo
	$(VENV)/bin/smsid demo --output demo-out

test: $(VENV)/.test
	$(VENV)/bin/python -m pytest -q -m "not slow" -n $(JOBS) --dist loadfile

test-slow: $(VENV)/.test
	$(VENV)/bin/python -m pytest -q -m slow

lint: $(VENV)/.test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/pyright --pythonpath $(VENV)/bin/python
	$(VENV)/bin/lint-imports --no-logo

docs: $(VENV)/.docs
	$(VENV)/bin/sphinx-build --fail-on-warning --keep-going --quiet docs build/docs
	@echo "build/docs/index.html"

$(VENV)/.demo: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable ".[view,fast]"
	touch $@

$(VENV)/.test: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable ".[view,video,control,robots,campaign,data,bags,parquet,plot,docs,test,lint]"
	touch $@

$(VENV)/.docs: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable ".[view,control,docs]"
	touch $@

clean:
	rm -rf $(VENV) build dist demo-out .pytest_cache .ruff_cache
