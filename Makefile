# Everything is set up by the targets themselves: Python 3.11 and make are all that a machine needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# How many processes share the tests.
WORKERS ?= 2
export OMP_WAIT_POLICY := PASSIVE

.PHONY: demo test test-blender test-window extension lint clean

demo: $(VENV)/.installed
	$(BIN)/unveil demo

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

# The add-on's tests under the two long-term Blenders before 5.0, whose bpy `make test` has.
test-blender: $(VENV)/.installed-test .venv-bpy-4.2/.installed .venv-bpy-4.5/.installed
	$(BIN)/python tests/blender_addon/run_in_blender.py .venv-bpy-4.2/bin/python
	$(BIN)/python tests/blender_addon/run_in_blender.py .venv-bpy-4.5/bin/python

# The artist's way through the add-on in a real window, and what must not cost work: see tests/blender_addon/window/.
BLENDER ?= blender
test-window: extension
	$(BIN)/python tests/blender_addon/window/click_path.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip -o build/window
	$(BIN)/python tests/blender_addon/window/no_lost_work.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip -o build/no_lost_work $(if $(SMALL_DISK),--small-disk "$(SMALL_DISK)")

# The Blender extension with the wheel of unveil_core that it installs, and a repository that Blender can be pointed at.
# Blender's own tool builds and checks it.
extension: BLENDER_EXT = $(shell $(BIN)/python -c "import importlib.util as u, pathlib as p; print(next(p.Path(u.find_spec('bpy').origin).parent.glob('*/scripts/addons_core/bl_pkg/cli/blender_ext.py')))")
extension: $(VENV)/.installed-test
	rm -rf build/extension dist/extension && mkdir -p build dist/extension
	cp -R blender_addon build/extension
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir build/extension/core .
	$(BIN)/python $(BLENDER_EXT) validate build/extension
	$(BIN)/python $(BLENDER_EXT) build --source-dir build/extension --output-dir dist/extension
	$(BIN)/python $(BLENDER_EXT) validate dist/extension/unveil-*.zip
	$(BIN)/python $(BLENDER_EXT) server-generate --repo-dir dist/extension --html

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
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[dev,bpy,gpu,datasets,farm]"
	touch $@

# Nothing but bpy and pytest: as in Blender, unveil_core is in a Python of its own.
.venv-bpy-%/.installed:
	test -x $(@D)/bin/python || $(PYTHON) -m venv $(@D)
	$(@D)/bin/python -m pip install --quiet "bpy==$*.*" "numpy<2" pytest
	touch $@
