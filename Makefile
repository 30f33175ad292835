# Everything is set up by the targets themselves: Python 3.11 and make are all that a machine needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OMP_WAIT_POLICY := PASSIVE

.PHONY: demo test lint clean

demo: $(VENV)/.installed
	$(BIN)/unveil demo

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check unveil_core tests
	$(BIN)/mypy

clean:
	rm -rf $(VENV) demo_workspace build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis

# torch comes first and alone, pinned: a looser range may take a build with gigabytes of CUDA.
$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet -c constraints.txt "$$(grep '^torch==' constraints.txt)"
	$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[dev,bpy,gpu]"
	touch $@
