# On a fresh Debian or Ubuntu with Python 3.10-3.13 and python3-venv: make demo, make test. Each first makes .venv.
# make test-target and make test-minimum make environments of their own, by the same rules.
PYTHON ?= python3
VENV := .venv
CONSTRAINTS :=
EXTRAS := ros,test,dev
TESTS := test
BIN := $(VENV)/bin
DEMO := $(VENV)/.demo
STAMP := $(VENV)/.installed
PYTHON_VERSION = $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
VENV_VERSION = $(shell $(BIN)/python -c 'import pip, sys; print("%d.%d" % sys.version_info[:2])' 2> /dev/null)
PIP := $(BIN)/python -m pip -qq --disable-pip-version-check
INSTALL := $(PIP) install --no-compile $(CONSTRAINTS:%=--constraint %)
# The first Python of this version that is there and can make an environment, such as $(call find-python,3.12).
find-python = $(shell for python in python$(1) "$${PYENV_ROOT:-$$HOME/.pyenv}"/versions/$(1).*/bin/python /usr/bin/python$(1); do \
	"$$python" -c 'import ensurepip' 2> /dev/null && echo "$$python" && break; done)
PYTHON312 = $(call find-python,3.12)
PYTHON_MINIMUM = $(or $(call find-python,3.10),$(call find-python,3.11))
missing = echo 'make $@ needs $(1) with its module venv, and finds none: install it, or name it in $(2)=' >&2; exit 2
LEG = --no-print-directory pytest EXTRAS=ros,test

.PHONY: demo test test-target python312 test-minimum pytest lint studies chart docs lines dist bench bench-node bench-swaps bench-replay bench-doctor soak fuzz venv clean

demo: $(DEMO)
	$(BIN)/rft demo -o out/demo

test: lint pytest

# without make's own variables: tests call make, too
pytest: venv
	env -u MAKEFLAGS -u MAKELEVEL $(BIN)/python -m pytest $(TESTS) -n $$((2 * $$(nproc))) --dist worksteal -q

# Ubuntu 24.04's own versions, and the least ones that setup.py allows.
test-target:
	@[ '$(PYTHON312)' ] || { $(call missing,Python 3.12,PYTHON312); }
	@$(MAKE) $(LEG) PYTHON='$(PYTHON312)' VENV=.venv-target CONSTRAINTS=constraints/ubuntu-24.04.txt

python312:
	@echo '$(PYTHON312)'

test-minimum:
	@[ '$(PYTHON_MINIMUM)' ] || { $(call missing,Python 3.10 or 3.11,PYTHON_MINIMUM); }
	@$(MAKE) $(LEG) PYTHON='$(PYTHON_MINIMUM)' VENV=.venv-minimum CONSTRAINTS=constraints/minimum.txt TESTS='test/unit test/golden'

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@if $(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then echo mypy && $(BIN)/mypy; \
	else echo 'mypy is not run: the types of the last NumPy for Python 3.10 are too coarse'; fi

studies: venv
	$(BIN)/python -m studies all -o out/studies --docs docs/paper.md --docs docs/accuracy.md

chart: venv
	$(BIN)/python -m studies models -o out/chart --docs docs/speed-accuracy.md

docs: venv
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

lines: venv
	$(BIN)/python -m bench.lines

dist: venv
	$(BIN)/python -m build

bench: venv
	$(BIN)/python -m bench.kernel

bench-node: venv
	$(BIN)/python -m bench.node

bench-swaps: venv
	$(BIN)/python -m bench.swaps

bench-replay: venv
	$(BIN)/python -m bench.replay

bench-doctor: venv
	$(BIN)/python -m bench.doctor
	$(BIN)/python -m bench.doctor --busy 2

soak: venv
	PYTHONPATH=.:test/unit $(BIN)/python test/ros/soak.py

fuzz: venv
	PYTHONPATH=test/unit $(BIN)/python test/fuzz.py

venv: $(STAMP)

# What the demo needs. Python compiles what it imports; of the rest pip would compile 15,000 files. Each step says one
# line; pip and venv say more only if they fail. A .venv that another Python began, or that has no pip, is begun again.
$(DEMO): setup.py package.xml $(CONSTRAINTS)
	@case '$(PYTHON_VERSION)' in 3.10|3.11|3.12|3.13) ;; *) \
	echo 'rft_ros needs Python 3.10 to 3.13, and $(PYTHON) is $(or $(PYTHON_VERSION),no Python): install one of these and name it,' \
	'as in make PYTHON=python3.12 $(MAKECMDGOALS)' >&2; exit 2;; esac
	@[ '$(VENV_VERSION)' = '$(PYTHON_VERSION)' ] \
	|| { echo 'Making $(VENV), an environment of Python $(PYTHON_VERSION)'; $(PYTHON) -m venv --clear $(VENV); }
	@echo 'Installing packages from PyPI, ROS among them: downloads about 200 MB, takes half a minute or more'
	@$(INSTALL) --editable '.[ros]'
	@touch $@

# pip 23.0, which comes with Python 3.10, looks for versions that fit together without end.
$(STAMP): $(DEMO)
	@echo 'Installing what tests and documentation need: takes half a minute or more'
	@$(PIP) install --upgrade pip
	@$(INSTALL) --editable '.[$(EXTRAS)]'
	@$(BIN)/rft warm-up
	@touch $@

clean:
	rm -rf .venv .venv-target .venv-minimum out build dist *.egg-info
