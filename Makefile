# Everything is set up by the targets themselves: Python 3.11 and make are all that a machine needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OMP_WAIT_POLICY := PASSIVE

.PHONY: demo test test-blender lint clean

demo: $(VENV)/.installed
	$(BIN)/unveil demo

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest

# The add-on's tests under the two long-term Blenders before 5.0, whose bpy `make test` has.
test-blender: $(VENV)/.installed-test .venv-bpy-4.2/.installed .venv-bpy-4.5/.installed
	$(BIN)/python tests/blender_addon/run_in_blender.py .venv-bpy-4.2/bin/python
	$(BIN)/python tests/blender_addon/run_in_blender.py .venv-bpy-4.5/bin/python

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check unveil_core tests blender_addon
	$(BIN)/mypy

clean:
	rm -rf $(VENV) .venv-bpy-* demo_workspace build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis

# torch comes first and alone, pinned: a looser range may take a build with gigabytes of CUDA.
$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet -c constraints.txt "$$(grep '^torch==' constraints.txt)"
	$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[dev,bpy,gpu]"
	touch $@

# Nothing but bpy and pytest: as in Blender, unveil_core is in a Python of its own.
.venv-bpy-%/.installed:
	test -x $(@D)/bin/python || $(PYTHON) -m venv $(@D)
	$(@D)/bin/python -m pip install --quiet "bpy==$*.*" "numpy<2" pytest
	touch $@
