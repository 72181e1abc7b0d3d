# The front door. Everything is done by `python -m replicate`; this file finds or makes the Python to run it with.
# For GNU make 3.81 and newer. Targets and benchmarks are those whose modules say what they are ABOUT.

PROFILE    ?= laptop
CHARACTERS ?=
METHODS    ?=
SEED       ?=
JOBS       ?=
CLUSTER    ?=
DEVICE     ?=
CONFIG     ?=
SPLIT      ?=
LATEX      ?=
ADD_SEEDS  ?=
DETAILS    ?=
ALL        :=
LESSONS    ?=
RELEASE    ?=
ICT_FACEKIT ?=
export ICT_FACEKIT
POSE       ?=
CLIP       ?=
PARAMS     ?=
LANDMARKS  ?=
ONTO       ?=
TO         ?=
TOLERANCE  ?=
ONLY       ?=
FORM       ?=
RECENT     := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON     ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c '$(RECENT)' 2>/dev/null && echo $$p && exit; done; echo python3)

# An active environment is used as it is if it has all packages, and .venv otherwise.
MODULES := anywidget basedpyright beartype dask_jobqueue distributed filelock furo ipykernel jax jaxtyping jupyter \
	jupytext matplotlib myst_nb nbclient nbformat nbgrader numba numpy onnx onnxruntime pandas PIL psutil pytest xdist pyvista ruff safetensors \
	sklearn scipy sphinx threadpoolctl torch tqdm trimesh websocket xatlas
COMPLETE := import sys, importlib.util as u; \
	print(*["yes"] * (sys.version_info >= (3, 11) and all(u.find_spec(m) for m in sys.argv[1:])))
ACTIVE := $(or $(VIRTUAL_ENV),$(CONDA_PREFIX))
ifneq ($(ACTIVE),)
USABLE := $(shell "$(ACTIVE)/bin/python" -c '$(COMPLETE)' $(MODULES) 2>/dev/null)
endif
ifeq ($(USABLE),yes)
RUN := "$(ACTIVE)/bin/python"
ENVIRONMENT :=
else
RUN := .venv/bin/python
ENVIRONMENT := .venv/installed
endif

# The list of targets is replicate/targets/targets.toml; a benchmark is a module that says what it is ABOUT.
LIST := replicate/targets/targets.toml
TARGETS := $(shell sed -n 's/^\[\(.*\)\]$$/\1/p' $(LIST))
ABOUT := $(shell grep -ls '^ABOUT = ' replicate/benchmarks/bench_*.py)
BENCHMARKS := $(patsubst replicate/benchmarks/bench_%.py,bench-%,$(ABOUT))

# The variables that are set, as options; what a target doesn't take, it leaves out.
VARIABLES := PROFILE CHARACTERS METHODS SEED JOBS CLUSTER DEVICE CONFIG SPLIT LATEX ADD_SEEDS POSE CLIP PARAMS TO \
	TOLERANCE LANDMARKS ONTO ONLY FORM DETAILS ALL
SWITCHES := LATEX ADD_SEEDS DETAILS ALL
option = $(if $($(1)),--$(shell echo $(1) | tr A-Z_ a-z-)$(if $(filter $(SWITCHES),$(1)),, '$(subst ','\'',$($(1)))'))
OPTIONS = $(foreach name,$(VARIABLES),$(call option,$(name)))

# A variable that nothing here reads is a typing error: CHARACTER=woman would otherwise show the default without a word.
KNOWN := $(VARIABLES) LESSONS RELEASE ICT_FACEKIT PYTHON REPLICATE_CACHE REPLICATE_RESULTS REPLICATE_PLAIN_KERNELS \
  REPLICATE_BLENDER_PYTHON NUMBA_CACHE_DIR JAX_COMPILATION_CACHE_DIR
GIVEN := $(foreach name,$(.VARIABLES),$(if $(findstring command line,$(origin $(name))),$(name)))
UNKNOWN := $(firstword $(filter-out $(KNOWN) MAKE%,$(GIVEN)))
ifneq ($(UNKNOWN),)
$(error $(shell $(PYTHON) -m replicate.base.spelling variable $(UNKNOWN) $(KNOWN) 2>&1))
endif

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.SUFFIXES:
.PHONY: help environment lab book course test test-fast lint mutants clean-all $(TARGETS) $(BENCHMARKS)

help: ## print this help
	@echo "usage: make <target> [VARIABLE=value ...]"
	@echo
	@awk -F ' = ' '/^\[/ { name = substr($$0, 2, length($$0) - 2) } { text = $$2; gsub(/^"|"$$/, "", text) } \
	  /^group = / && text != group { if (group) print ""; group = text; print group } \
	  /^about = / { printf "  %-15s %s\n", name, text }' $(LIST)
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / { printf "  %-15s %s\n", $$1, $$2 }' Makefile
	@echo
	@echo benchmarks
	@awk '/^ABOUT = / { name = FILENAME; sub(/.*\/bench_/, "", name); sub(/\.py$$/, "", name); sub(/^ABOUT = "/, ""); \
	  sub(/"$$/, ""); printf "  bench-%-9s %s\n", name, $$0 }' $(ABOUT)
	@echo
	@echo variables
	@echo "  PROFILE=$(PROFILE)    quick, laptop or paper: how many samples and steps"
	@echo "  CHARACTERS=     names, or paths of .toml recipes, of .glb files or of folders, separated by commas or spaces"
	@echo "                  (default: teen; for what trains nothing, all of teen woman dragon toon)"
	@echo "  METHODS=        the rows of tables: names, or paths of .py files with a method of your own; all for all"
	@echo "  SEED=  JOBS=  DEVICE=  CONFIG=  SPLIT=  CLUSTER=   as \`python -m replicate table2 --help\` says"
	@echo "  POSE=  CLIP=  PARAMS=  TO=  TOLERANCE=   as \`python -m replicate export --help\` says"
	@echo "  LANDMARKS=      for capture: a recording of an actor's face, as \`python -m replicate capture --help\` says"
	@echo "  ONTO=           for figure13: other characters whose faces the networks move as well"
	@echo "  ONLY='a|b'      some of a benchmark's trainings, as \`python -m replicate.benchmarks.bench_training --help\` says"
	@echo "  FORM=           for deploy: vertices (default), or shapes and a network to their weights, as engines have them"
	@echo "  ADD_SEEDS=1     \`make reference\` adds a run's seeds to those that are committed"
	@echo "  LATEX=1         \`make compare\` and \`make claims\` in LaTeX"
	@echo "  DETAILS=1       \`make status\` with a line for every artefact, its hash and its state"
	@echo "  ALL=1           \`make compare\` with the rows that your results lack; \`make clean\` of everything"
	@echo "  LESSONS=  RELEASE=   for course: only some lessons, \"3 4\"; a new folder for nbgrader"
	@echo "  ICT_FACEKIT=    the folder of ICT-FaceKit, for CHARACTERS=ict: a face that nobody here made"
	@echo "  PYTHON=         the Python, 3.11 or newer, that .venv is made with"

environment: $(ENVIRONMENT) ## make .venv with the exact packages, unless an active environment has them

# exec: a signal to make's child reaches Python itself, not a shell that leaves it behind. Python ends with its make,
# whose number only make itself can tell for sure: it may be killed before Python asks for its parent.
MAKE_PID = $(shell echo $$PPID)

$(TARGETS): $(ENVIRONMENT)
	@exec $(RUN) -m replicate $@ --from-make $(MAKE_PID) $(OPTIONS)

$(BENCHMARKS): bench-%: $(ENVIRONMENT)
	@exec $(RUN) -m replicate.benchmarks.bench_$* --from-make $(MAKE_PID) $(OPTIONS)

lab: $(ENVIRONMENT) ## open the notebooks in JupyterLab
	@PYTHONPATH="$(CURDIR)$${PYTHONPATH:+:$$PYTHONPATH}" exec $(RUN) -m jupyterlab --LabApp.app_settings_dir=.lab --LabApp.default_url=/lab/tree/notebooks/README.md

book: $(ENVIRONMENT) ## build a site of the notebooks, the pages and the modules, to read without a network
	@exec $(RUN) book/build.py

course: $(ENVIRONMENT) ## make the notebooks of the course from their sources, and run them
	@exec $(RUN) course/build.py $(call option,LESSONS) $(call option,RELEASE)

# Many containers say PYTHONDONTWRITEBYTECODE. Each process that tests start would then parse all sources anew.
test: $(ENVIRONMENT) ## run all tests
	@exec env -u PYTHONDONTWRITEBYTECODE $(RUN) -m pytest -n logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder

test-fast: $(ENVIRONMENT) ## run the tests that take moments: nothing is trained, no browser and no cluster started
	@exec env -u PYTHONDONTWRITEBYTECODE $(RUN) -m pytest -m "not slow" -n logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder

lint: $(ENVIRONMENT) ## check the style of the sources, and the types of the contracts
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m basedpyright --pythonpath $(RUN)

mutants: $(ENVIRONMENT) ## break core lines one at a time in a copy, and see that tests notice
	@exec $(RUN) tests/mutants.py $(call option,ONLY) $(call option,JOBS)

clean-all: $(ENVIRONMENT) ## remove all artefacts and your own results
	@$(RUN) -m replicate clean --all
	rm -rf results/runs

.venv/installed: requirements.lock torch.lock
	@.venv/bin/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -c '$(RECENT)' 2>/dev/null || { \
	  echo "Python 3.11 or newer is needed, and $(PYTHON) is `$(PYTHON) --version 2>&1 | head -n 1`:" \
	  "name one with PYTHON=/path/to/python3" >&2; exit 2; }
	@.venv/bin/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --disable-pip-version-check --require-hashes --no-deps -r requirements.lock
	.venv/bin/python -m pip install --disable-pip-version-check -r torch.lock
	@touch $@

Makefile: ;

# Any other word: which target was meant.
%:
	@$(PYTHON) -m replicate.base.spelling target $@ $(TARGETS) $(BENCHMARKS) help environment lab book course test test-fast lint mutants clean-all
