# Two commands do all the set-up:
#   make demo            installs into .venv, runs the main job on embedded data; OUT=dir chooses where results go
#   make test            installs what is missing, runs ruff, mypy and the tests
# The second run of either installs nothing.

OUT ?= out/demo
VENV := .venv
PYTHON ?= $(firstword $(foreach p,python3.11 python3.12 python3.13 python3,$(shell command -v $(p))))
BIN := $(VENV)/bin
# whatever changes what has to be installed or compiled
SOURCES := pyproject.toml CMakeLists.txt $(wildcard src/coin3d/native/*.cpp src/coin3d/native/*.h)
DEVKIT := tests/evaluation/devkit-requirements.txt
PIP_FLAGS := --disable-pip-version-check

.DELETE_ON_ERROR:
.PHONY: help demo test lint format clean

help:
	@sed -n '1,/^$$/s/^# \{0,1\}//p' Makefile

demo: $(VENV)/.town
	$(BIN)/coin3d demo --out $(OUT)

test: $(VENV)/.test .venv-devkit/.installed
	$(MAKE) lint
	$(BIN)/pytest

lint: $(VENV)/.test
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

format: $(VENV)/.test
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean:
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@echo "kept: $(VENV), .venv-devkit and results; delete them by hand"

# Editable: the command runs this checkout, so changed Python needs no new installation.
$(VENV)/.town: $(SOURCES) | $(BIN)/python
	@echo "installing into $(VENV): minutes, most of them for torch"
	$(BIN)/python -m pip install $(PIP_FLAGS) --editable '.[town]'
	@touch $@

$(VENV)/.test: $(SOURCES) | $(BIN)/python
	@echo "installing into $(VENV): minutes, most of them for torch"
	$(BIN)/python -m pip install $(PIP_FLAGS) --editable '.[town,test]'
	@touch $(VENV)/.town $@

# nuScenes' own evaluation, which ours is compared with, wants an old numpy: an environment of its own (100 MB)
.venv-devkit/.installed: $(DEVKIT)
	@$(MAKE) --no-print-directory check-python
	$(PYTHON) -m venv .venv-devkit
	.venv-devkit/bin/python -m pip install $(PIP_FLAGS) --no-deps -r $(DEVKIT)
	@touch $@

$(BIN)/python:
	@$(MAKE) --no-print-directory check-python
	$(PYTHON) -m venv $(VENV)

.PHONY: check-python
check-python:
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed and none was found; name one: make PYTHON=/path/to/python3" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "$(PYTHON) is older than Python 3.11; name a newer one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null \
	  || { echo "$(PYTHON) lacks venv; on Debian: apt install python3-venv" >&2; exit 1; }
	@$(PYTHON) -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' \
	  || { echo "$(PYTHON) lacks its headers (Python.h); on Debian: apt install python3-dev" >&2; exit 1; }
	@command -v $(firstword $(CXX)) >/dev/null \
	  || { echo "no C++ compiler ($(CXX)) was found; on Debian: apt install g++" >&2; exit 1; }
