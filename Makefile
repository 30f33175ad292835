# Everything is set up by the targets themselves: Python 3.11 and make are all that a machine needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# How many processes share the tests: one more than two processors, for a test often waits for a program that it has started.
WORKERS ?= 3
export OMP_WAIT_POLICY := PASSIVE
# Each of the many programs that tests start would compile every module again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test quality test-blender test-window extension dist wheels docs lint lock clean

demo: $(VENV)/.installed
	$(BIN)/unveil demo

# The add-on's tests need a Blender, and a few run with the oldest NumPy: each of these has an environment of its own.
test: $(VENV)/.installed-test .venv-bpy-5.0/.installed .venv-numpy-1/.installed
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

# Slow checks, with the same kind of assertions as tests have.
quality: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile tests/slow

# The add-on's tests under every other Blender that it supports (`make test` runs them under 5.0). bpy is built for one Python alone: up to
# 5.0 for 3.11, since then for 3.13, and the newer ones are left out where that is not there.
PYTHON_3_13 ?= python3.13
BLENDERS := 4.2 4.5 $(if $(shell command -v $(PYTHON_3_13)),5.1 5.2 5.3)
test-blender: $(VENV)/.installed-test $(BLENDERS:%=.venv-bpy-%/.installed)
	$(if $(findstring 5.3,$(BLENDERS)),,@echo "There is no $(PYTHON_3_13): not tested under Blender 5.1 to 5.3.")
	$(BIN)/python tests/blender_addon/run_in_blender.py $(BLENDERS:%=.venv-bpy-%/bin/python)

# The artist's way through the add-on in a real window, and what must not cost work: see tests/blender_addon/window/. The pages' pictures
# are made there, too.
BLENDER ?= blender
test-window: extension
	$(BIN)/python tests/blender_addon/window/click_path.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip -o build/window
	$(BIN)/python tests/blender_addon/window/no_lost_work.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip -o build/no_lost_work $(if $(SMALL_DISK),--small-disk "$(SMALL_DISK)")
	$(BIN)/python tests/blender_addon/window/opened_files.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip -o build/opened_files
	$(BIN)/python tests/blender_addon/window/working_day.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip -o build/working_day
	$(BIN)/python tests/blender_addon/window/fix_by_hand.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip -o build/fix_by_hand
	$(BIN)/python tests/blender_addon/window/states.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip --workspace build/fix_by_hand/ws -o build/states
	$(BIN)/python tests/blender_addon/window/pictures.py --blender "$(BLENDER)" --extension dist/extension/unveil-*.zip --workspace build/fix_by_hand/ws -o build/pictures --into blender_addon/pictures

# The Blender extension with the wheel of unveil_core that it installs, and a repository that Blender can be pointed at.
# Blender's own tool builds and checks it.
extension: BLENDER_EXT = $(shell .venv-bpy-5.0/bin/python -c "import importlib.util as u, pathlib as p; print(next(p.Path(u.find_spec('bpy').origin).parent.glob('*/scripts/addons_core/bl_pkg/cli/blender_ext.py')))")
extension: $(VENV)/.installed-test .venv-bpy-5.0/.installed
	rm -rf build/extension dist/extension && mkdir -p build dist/extension
	cp -R blender_addon build/extension
	$(if $(WEBSITE),printf 'website = "%s"\n' "$(WEBSITE)" | sed -i '/^maintainer/r /dev/stdin' build/extension/blender_manifest.toml)
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir build/extension/core .
	cd build/extension/core && ../../../$(BIN)/python -m pip hash --algorithm sha256 unveil_core-*.whl > unveil_core.hash
	cp $(foreach lock,pip core torch cuda,requirements/$(lock).txt) requirements/solve.txt build/extension/core
	$(BIN)/python $(BLENDER_EXT) validate build/extension
	$(BIN)/python $(BLENDER_EXT) build --source-dir build/extension --output-dir dist/extension
	$(BIN)/python $(BLENDER_EXT) validate dist/extension/unveil-*.zip
	$(BIN)/python $(BLENDER_EXT) server-generate --repo-dir dist/extension --html

# What a release is: wheel, source archive, and the repository of the extension, whose index.json Blender's own updater reads.
dist: extension
	rm -f dist/*.whl dist/*.tar.gz
	$(BIN)/python -m hatchling build --target sdist --target wheel
	$(BIN)/python requirements/release.py dist

# A folder of wheels for machines without a network, by the lock files: the add-on's preferences name it. See requirements/wheels.py.
# torch without CUDA: TORCH_INDEX=https://download.pytorch.org/whl/cpu. Another system: FOR="--platform win_amd64".
wheels:
	$(PYTHON) requirements/wheels.py "$(FOLDER)" "$(TORCH_INDEX)" "$(FOR)"

# All pages as a site, in build/docs/: docs/conf.py. Needs no network; a link that leads nowhere is an error.
docs: $(VENV)/.installed-test
	$(BIN)/python docs/generate.py
	$(BIN)/python -m sphinx -q -W --keep-going -b html -c docs . build/docs
	@echo "build/docs/index.html"

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check unveil_core tests blender_addon
	$(BIN)/mypy
	$(BIN)/python lint/style.py
	$(BIN)/python requirements/check.py
	@$(MAKE) --silent build/audit/.installed >/dev/null 2>&1 || true
	$(BIN)/python requirements/audit.py build/audit/bin/pip-audit

# What this Makefile made, and nothing else: demo_workspace/ may hold what somebody painted, and stays.
clean:
	rm -rf $(VENV) .venv-bpy-* .venv-numpy-1 build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis

# Packages come from requirements/ alone: each has its version and its hashes there, and nothing else is taken.
LOCKED := -m pip install --quiet --require-hashes --no-deps
# Whether the torch that is installed needs CUDA's libraries: that of the usual index for Linux does, builds for the processor do not.
WITH_CUDA := -c "import importlib.metadata as m; raise SystemExit(not any('nvidia' in r or 'cuda' in r for r in m.requires('torch')))"

$(VENV)/.installed: pyproject.toml $(wildcard requirements/*.txt)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python $(LOCKED) -r requirements/build.txt -r requirements/core.txt
	$(BIN)/python $(LOCKED) -r requirements/torch-cpu.txt 2>/dev/null || $(BIN)/python $(LOCKED) -r requirements/torch.txt
	if $(BIN)/python $(WITH_CUDA); then $(BIN)/python $(LOCKED) -r requirements/cuda.txt; fi
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python $(LOCKED) -r requirements/dev.txt
	$(BIN)/python -m pip check
	touch $@

# Nothing but bpy and pytest: as in Blender, unveil_core is in a Python of its own.
.venv-bpy-5.1/.installed .venv-bpy-5.2/.installed .venv-bpy-5.3/.installed: PYTHON := $(PYTHON_3_13)
.venv-bpy-%/.installed: requirements/bpy-%.txt
	test -x $(@D)/bin/python || $(PYTHON) -m venv $(@D)
	$(@D)/bin/python $(LOCKED) -r $<
	touch $@

# pip-audit, with nothing of the project: what it needs is no part of what is installed.
build/audit/.installed: requirements/audit.txt
	test -x $(@D)/bin/python || $(PYTHON) -m venv $(@D)
	$(@D)/bin/python $(LOCKED) -r $<
	touch $@

# NumPy of the series 1 before all else that $(VENV) has: its packages run with both.
.venv-numpy-1/.installed: requirements/numpy-1.txt $(VENV)/.installed-test
	test -x $(@D)/bin/python || $(PYTHON) -m venv $(@D)
	$(@D)/bin/python $(LOCKED) -r $<
	$(BIN)/python -c "import sysconfig; print(f'import site; site.addsitedir({sysconfig.get_path(\"purelib\")!r})')" > "$$($(@D)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/others.pth"
	$(@D)/bin/python -c "import numpy, cv2, unveil_core; assert numpy.__version__ < '2', numpy"
	touch $@

# The lock files anew, from constraints.txt and pyproject.toml; uv asks the package index for the hashes.
lock:
	test -x build/lock/bin/uv || { $(PYTHON) -m venv build/lock && build/lock/bin/python -m pip install --quiet uv; }
	$(PYTHON) requirements/lock.py build/lock/bin/uv
