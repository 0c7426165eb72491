# vtff: every target sets up what it needs; nothing is done twice.
SHELL := /bin/bash
.DEFAULT_GOAL := help
ENVIRONMENT := . .venv/vtff_environment.sh
PYTEST_ARGUMENTS ?=
TEST_PROCESSES ?= 2
SYSTEM ?= config/system/reference.yaml
# Scenario seconds of the run that `make demo` flies first: acquisition and some keeping.
FIRST_RESULT = 300

.PHONY: help setup setup_test demo test bench docs libraries lint clean

help:  ## Show the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):[^#]*## /  make \1\t/' | expand -t 14

setup:  ## Make .venv with ROS 2 Jazzy from PyPI and build the workspace
	@tools/setup.sh

setup_test: # the same and what the tests need
	@tools/setup.sh test

demo: setup  ## Fly the reference formation, print the result beside the paper's, write plots
	@.venv/bin/vtff run $(SYSTEM) --duration $(FIRST_RESULT)
	@echo && echo "That was the first result. The whole run follows; Ctrl-C ends it in order." && echo
	@.venv/bin/vtff run $(SYSTEM)

test: setup_test  ## Run all tests but the slow ones; says what it leaves out
	@$(ENVIRONMENT) && python -m pytest -n $(TEST_PROCESSES) --dist loadfile --no-loadscope-reorder $(PYTEST_ARGUMENTS)

bench: setup  ## Run the benchmarks, one after the other (idle machine, please)
	@$(ENVIRONMENT) && python benchmarks/run_all.py

docs: setup  ## Build the documentation site into docs/html and check it
	@tools/build_docs.sh

libraries: setup_test  ## Install the libraries into an empty environment without ROS and try them
	@$(ENVIRONMENT) && python -m pytest -n 0 -m slow test/test_libraries.py

lint: setup_test  ## Check format, style and types
	@$(ENVIRONMENT) && ruff check . && ruff format --check . && python -m mypy

clean:  ## Remove everything that set-up and the build made
	rm -rf .venv build install log docs/html docs/generated docs/jupyter_execute src/vtff_analysis/vtff_analysis/view/web/cesium
