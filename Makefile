# The front door. Everything is done by `python -m replicate`; this file finds or makes the Python to run it with.
# For GNU make 3.81 and newer.

PROFILE    ?= laptop
CHARACTERS ?= teen
SEVERAL    := $(strip $(foreach name,teen woman dragon toon,$(if $(wildcard data_recipes/$(name).toml),$(name))))
SEED       ?=
JOBS       ?=
DEVICE     ?=
CONFIG     ?=
SPLIT      ?=
LATEX      ?=
ICT_FACEKIT ?=
export ICT_FACEKIT
POSE       ?=
CLIP       ?=
PARAMS     ?=
TO         ?=
TOLERANCE  ?=
RECENT     := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON     ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c '$(RECENT)' 2>/dev/null && echo $$p && exit; done; echo python3)

# An active environment is used as it is if it has all packages, and .venv otherwise.
MODULES := beartype filelock ipykernel jax jaxtyping jupyter matplotlib nbclient nbformat numba numpy pandas PIL \
	psutil pytest xdist pyvista ruff safetensors sklearn scipy threadpoolctl torch tqdm trimesh
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

RUN_OPTIONS = --profile "$(PROFILE)" --characters "$(CHARACTERS)" $(OTHER_OPTIONS)
# Table 1 and the figures of rigs take few minutes: all of the paper's characters, unless some are named.
CAST_OPTIONS = --profile "$(PROFILE)" --characters "$(if $(filter file,$(origin CHARACTERS)),$(SEVERAL),$(CHARACTERS))" \
	$(OTHER_OPTIONS)
OTHER_OPTIONS = $(if $(SEED),--seed "$(SEED)") \
	$(if $(DEVICE),--device "$(DEVICE)") $(if $(CONFIG),--config "$(CONFIG)") $(if $(SPLIT),--split "$(SPLIT)")
JOB_OPTIONS = $(if $(JOBS),--jobs "$(JOBS)")

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.SUFFIXES:
.PHONY: help environment table1 table2 figure05 figure07 figure08 lbs compare reference rigs tour export status test lint bench-rig bench-poses bench-floors bench-lbs bench-training bench-faults clean clean-all

help: ## print this help
	@echo "usage: make <target> [VARIABLE=value ...]"
	@echo
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / { printf "  %-14s %s\n", $$1, $$2 }' Makefile
	@echo
	@echo "  PROFILE=$(PROFILE)    quick, laptop or paper: how many samples and steps"
	@echo "  CHARACTERS=$(CHARACTERS)   names, or paths of .toml recipes, separated by commas or spaces"
	@echo "                  (table1, figure05, figure07, figure08, rigs and bench-rig: $(SEVERAL), unless some are named)"
	@echo "  SEED=  JOBS=  DEVICE=  CONFIG=  SPLIT=   as \`python -m replicate table2 --help\` says"
	@echo "  POSE=  CLIP=  PARAMS=  TO=  TOLERANCE=   as \`python -m replicate export --help\` says"
	@echo "  LATEX=1         \`make compare\` in LaTeX"
	@echo "  ICT_FACEKIT=    the folder of ICT-FaceKit, for CHARACTERS=ict: a face that nobody here made"
	@echo "  PYTHON=         the Python, 3.11 or newer, that .venv is made with"

environment: $(ENVIRONMENT) ## make .venv with the exact packages, unless an active environment has them

table1: $(ENVIRONMENT) ## counts of segments and sizes of models, beside the paper's
	@$(RUN) -m replicate table1 $(CAST_OPTIONS) $(JOB_OPTIONS)

table2: $(ENVIRONMENT) ## approximation errors on held-out poses, beside the paper's
	@$(RUN) -m replicate table2 $(RUN_OPTIONS) $(JOB_OPTIONS)

figure05: $(ENVIRONMENT) ## poses of the training data, and strips of the clips behind them
	@$(RUN) -m replicate figure05 $(CAST_OPTIONS) $(JOB_OPTIONS)

figure07: $(ENVIRONMENT) ## the mesh segments in colours
	@$(RUN) -m replicate figure07 $(CAST_OPTIONS) $(JOB_OPTIONS)

figure08: $(ENVIRONMENT) ## the refinement segments in colours
	@$(RUN) -m replicate figure08 $(CAST_OPTIONS) $(JOB_OPTIONS)

lbs: $(ENVIRONMENT) ## linear blend skinning: bones, weights, errors against their number
	@$(RUN) -m replicate lbs $(RUN_OPTIONS) $(JOB_OPTIONS)

compare: $(ENVIRONMENT) ## print the paper's numbers, the reference results and yours
	@$(RUN) -m replicate compare --profile "$(PROFILE)" $(if $(LATEX),--latex)

reference: $(ENVIRONMENT) ## put your results and benchmarks in the place of the committed ones
	@$(RUN) -m replicate reference --profile "$(PROFILE)"

rigs: $(ENVIRONMENT) ## draw the characters: views, wireframe, charts, expressions
	@$(RUN) -m replicate rigs --characters "$(if $(filter file,$(origin CHARACTERS)),$(SEVERAL),$(CHARACTERS))"

export: $(ENVIRONMENT) ## write a pose as OBJ or GLB, or a clip as an animated GLB
	@$(RUN) -m replicate export --characters "$(CHARACTERS)" $(if $(POSE),--pose "$(POSE)") \
	  $(if $(CLIP),--clip "$(CLIP)") $(if $(PARAMS),--params "$(PARAMS)") $(if $(TO),--to "$(TO)") \
	  $(if $(TOLERANCE),--tolerance "$(TOLERANCE)")

tour: $(ENVIRONMENT) ## a notebook that takes a rig apart: layers, wrinkles, sliders, derivatives, speed
	@$(RUN) -m replicate tour --characters "$(CHARACTERS)"

status: $(ENVIRONMENT) ## list which artefacts are up to date, and what the cache holds
	@$(RUN) -m replicate status $(RUN_OPTIONS)

test: $(ENVIRONMENT) ## run all tests
	$(RUN) -m pytest -n logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder

lint: $(ENVIRONMENT) ## check the style of the sources
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .

bench-rig: $(ENVIRONMENT) ## poses per second of all rigs, batched and one at a time, and each deformer's share
	@$(RUN) -m replicate.benchmarks.rig $(if $(filter-out file,$(origin CHARACTERS)),--characters "$(CHARACTERS)")

bench-poses: $(ENVIRONMENT) ## how many poses are broken: flipped triangles, teeth through skin, eyes through lids
	@$(RUN) -m replicate.benchmarks.poses --characters "$(CHARACTERS)"

bench-floors: $(ENVIRONMENT) ## what maps of several resolutions can hold at best, where skin wrinkles and elsewhere
	@$(RUN) -m replicate.benchmarks.floors --profile "$(PROFILE)" --characters "$(CHARACTERS)"

bench-lbs: $(ENVIRONMENT) ## our SSDR beside Dem Bones (pip install py-dem-bones) on the same poses
	@$(RUN) -m replicate.benchmarks.lbs $(if $(filter-out file,$(origin CHARACTERS)),--characters "$(CHARACTERS)")

bench-training: $(ENVIRONMENT) ## what peak rates and balanced draws do to the networks' errors
	@$(RUN) -m replicate.benchmarks.training --profile "$(PROFILE)" --characters "$(CHARACTERS)"

bench-faults: $(ENVIRONMENT) ## what deliberate faults do to the numbers of Table 2
	@$(RUN) -m replicate.benchmarks.faults --profile "$(PROFILE)" --characters "$(CHARACTERS)"

clean: $(ENVIRONMENT) ## remove stale, damaged and unfinished artefacts from the cache
	@$(RUN) -m replicate clean-cache

clean-all: $(ENVIRONMENT) ## remove all artefacts and your own results
	@$(RUN) -m replicate clean-cache --all
	rm -rf results/runs

.venv/installed: requirements.lock
	@.venv/bin/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -c '$(RECENT)' 2>/dev/null || { \
	  echo "Python 3.11 or newer is needed, and $(PYTHON) is `$(PYTHON) --version 2>&1 | head -n 1`:" \
	  "name one with PYTHON=/path/to/python3" >&2; exit 2; }
	@.venv/bin/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --disable-pip-version-check -r requirements.lock
	@touch $@
