# Two commands: `make demo` sets everything up and runs the main job, `make test` sets everything
# up and passes the tests. Both work on a fresh machine with Python 3.11 or newer.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt

.PHONY: demo test clean

demo: clean
	@$(MAKE) --no-print-directory $(VENV)/bin/python
	@echo 'installing mdkf into $(VENV): a minute or two, 1.2 GB with the simulators'
	@$(INSTALL) -e .
	@sh .ci/system-libraries
	$(BIN)/mdkf run --out out

KERNELS = from experiments.warm_up import compile_sensing, compile_tracking; from mdkf import ESTIMATORS

test: $(VENV)/bin/python
	@echo 'installing mdkf with its tests into $(VENV)'
	@$(INSTALL) -e '.[test]'
	@sh .ci/system-libraries
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	@echo 'compiling the kernels beside the type check: each of the processes of tests would compile all'
	@$(BIN)/python -c '$(KERNELS); compile_tracking([*ESTIMATORS])' & \
	  $(BIN)/mypy && $(BIN)/python -c '$(KERNELS); compile_sensing()' && wait $$!
	$(BIN)/python -m pytest -n 2 --dist worksteal

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "mdkf needs Python 3.11 or newer; set PYTHON=..., e.g. make demo PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)

clean:
	rm -rf $(VENV)
