# `make demo`, `make test` and `make statistics` do all the set-up themselves: they need Python
# 3.11 or later with venv, and nothing else that is installed on the machine.
#
#   PYTHON=python3.12   the interpreter to build the environment from
#   VENV=path           where the environment lies
#   PYTEST_ARGS="..."   further arguments of pytest
#   ONLY="rig/* bad/*", SAMPLE=8, JOBS=2   names of the cases of `make golden`, every n-th, processes
#   COUNT=100, PEERS=lmfit   machines of a benchmark, and who else meets them
#   EVERY_CASE=1        of large banks all cases, not the part that the commit draws
#   FUZZ_ARGS="..."     what `make fuzz` is to damage: see tests/fuzz_run.py

VENV ?= .venv
CONSTRAINTS ?= constraints.txt
FUZZ_ARGS ?= --each 1000
SAMPLE ?= 1
JOBS ?= 2
GOLDEN_ARGS ?=
BENCH := build/bench
PEERS ?= numpy figaroh pysindy nfoursid lmfit odrpack
COUNT ?= 100
PYTHON ?= python3 python3.14 python3.13 python3.12 python3.11 python
PYTEST_ARGS ?=
BIN := $(VENV)/bin
REPORT := rotorid-demo.html
PAPER := rotorid-demo-paper.html

unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV PIP_TARGET PIP_PREFIX PIP_USER
unexport PYTHONDONTWRITEBYTECODE  # with it each process compiles the package and the tests anew
export PYTHONNOUSERSITE := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_NO_INPUT := 1

.PHONY: help demo test types fast statistics docs golden golden-record census fuzz bench bench-rotors bench-answers test-lowest test-newest clean

help:
	@echo "make demo         set up, run the demonstration, write its reports ($(REPORT), $(PAPER))"
	@echo "make test         set up, then lint and the fast tests: minutes"
	@echo "make statistics   types; the slow tests: coverage of deviations, banks of faults; the documentation"
	@echo "make docs         the documentation, its examples run: docs/_build/html/index.html"
	@echo "make golden       what every command said, held against the record: SAMPLE=8 for a part"
	@echo "make golden-record   the record anew, of ONLY=\"rig/* bad/*\" or of all"
	@echo "make census       lines and modules by package, and what else the source comes to"
	@echo "make fuzz         a thousand damaged files of each format, drawn from the commit"
	@echo "make bench        rotorid beside its peers, each in an environment of its own: docs/peers.md"
	@echo "make bench-rotors SIMULATOR=machines.py   the same with machines of your own simulator"
	@echo "make test-lowest  the fast tests with the lowest versions that pyproject.toml allows;"
	@echo "make test-newest  and with the newest there are"
	@echo "make clean        remove the environment and what the tools leave behind"

demo: $(VENV)/.ready-demo
	$(BIN)/rotorid demo --machine $(REPORT) --report $(PAPER)
	@echo "The report of the machine lies in $(CURDIR)/$(REPORT), that of the paper in $(PAPER)"
	@echo "Next: docs/start.md"

# One BLAS thread per worker: the matrices are small, and the workers fill the cores.
test fast statistics docs fuzz bench bench-rotors test-lowest test-newest: export OPENBLAS_NUM_THREADS := 1
test fast statistics docs fuzz bench bench-rotors test-lowest test-newest: export OMP_NUM_THREADS := 1

test: $(VENV)/.ready-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@$(MAKE) --no-print-directory fast

types: $(VENV)/.ready-test
	$(BIN)/mypy

fast: $(VENV)/.ready-test
	$(BIN)/pytest -n auto --dist loadfile -m "not slow" $(PYTEST_ARGS)

statistics: types
	$(BIN)/pytest -n auto --dist worksteal -m slow $(PYTEST_ARGS)
	$(MAKE) docs

docs: $(VENV)/.ready-test
	rm -rf docs/gallery
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet docs docs/_build/html

golden: $(VENV)/.ready-test
	$(BIN)/python -m golden compare --only "$(ONLY)" --sample $(SAMPLE) --jobs $(JOBS) $(GOLDEN_ARGS)

golden-record: $(VENV)/.ready-test
	$(BIN)/python -m golden record --only "$(ONLY)" --sample $(SAMPLE) --jobs $(JOBS) $(GOLDEN_ARGS)

census: $(VENV)/.ready-test
	$(BIN)/python tests/census.py

fuzz: $(VENV)/.ready-test
	$(BIN)/python tests/fuzz_run.py $(FUZZ_ARGS)

# What rotorid and its peers make of the same cases; each peer has an environment of its own.
bench: $(VENV)/.ready-test $(PEERS:%=$(BENCH)/env/%/.ready) $(BENCH)/env/ross/.ready
	rm -rf $(BENCH)/eight $(BENCH)/four
	$(BIN)/python benchmarks/peers/cases.py $(BENCH)/eight $(COUNT)
	$(BIN)/python benchmarks/peers/cases.py $(BENCH)/four $(COUNT) --sensors 4
	@$(MAKE) --no-print-directory bench-answers OUT=$(BENCH)/eight
	@$(MAKE) --no-print-directory bench-answers OUT=$(BENCH)/four
	$(BIN)/python benchmarks/rig_ross.py

bench-rotors: $(VENV)/.ready-test $(PEERS:%=$(BENCH)/env/%/.ready)
	rm -rf $(BENCH)/rotors
	$(BIN)/python benchmarks/peers/cases.py $(BENCH)/rotors $(COUNT) --sensors 4 --spread 0.3 --simulator "$(SIMULATOR)"
	@$(MAKE) --no-print-directory bench-answers OUT=$(BENCH)/rotors

bench-answers:
	$(BIN)/python benchmarks/peers/with_rotorid.py $(OUT)
	for peer in $(PEERS); do $(BENCH)/env/$$peer/bin/python benchmarks/peers/with_$$peer.py $(OUT) || exit; done
	$(BIN)/python benchmarks/peers/score.py $(OUT)

$(BENCH)/env/%/.ready: benchmarks/peers/requirements/%.txt | $(VENV)/.ready-test
	$(BIN)/python -m venv --clear $(@D)
	$(@D)/bin/python -m pip install --quiet --requirement $<
	@touch $@

# Old packages use what others have deprecated since: that is theirs to mend.
test-lowest:
	$(MAKE) VENV=.venv-lowest CONSTRAINTS=.venv-lowest/lowest.txt .venv-lowest/.ready-test
	.venv-lowest/bin/pytest -n auto -m "not slow" -W ignore::DeprecationWarning $(PYTEST_ARGS)

test-newest:
	$(MAKE) VENV=.venv-newest CONSTRAINTS=/dev/null .venv-newest/.ready-test
	.venv-newest/bin/pytest -n auto -m "not slow" $(PYTEST_ARGS)

clean:
	rm -rf $(VENV) .venv-lowest .venv-newest build dist src/*.egg-info
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis
	rm -rf docs/_build docs/gallery docs/generated
	rm -f $(REPORT) $(PAPER)

# The environment, renewed where the packages it holds may have changed. An interpreter that no
# longer runs (a Python that was upgraded or removed) makes it start afresh. Modules are compiled
# when they are first imported: most never are, and compiling all takes half of the set-up.
$(VENV)/.ready-demo: EXTRAS :=
$(VENV)/.ready-test: EXTRAS := [test]
$(VENV)/.ready-demo $(VENV)/.ready-test: pyproject.toml constraints.txt
	@for python in $(PYTHON); do \
	    "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && break; \
	    python=; \
	done; \
	if [ -z "$$python" ]; then \
	    found=$$(for python in $(PYTHON); do "$$python" --version 2>/dev/null && break; done); \
	    echo "rotorid needs Python 3.11 or later; found $${found:-none}" >&2; \
	    echo "Install one, or name it: make PYTHON=/path/to/python3.11 ..." >&2; \
	    exit 1; \
	fi; \
	if ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then \
	    echo "$$python has no venv with pip in it; on Debian: apt install python3-venv" >&2; \
	    exit 1; \
	fi; \
	clear=; \
	"$(BIN)/python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || clear=--clear; \
	echo "Setting up $(VENV) with $$("$$python" --version), a minute or two"; \
	"$$python" -m venv $$clear "$(VENV)"
	@case "$(CONSTRAINTS)" in \
	    */lowest.txt) "$(BIN)/python" tests/lowest.py > "$(CONSTRAINTS)" ;; \
	esac
	@"$(BIN)/python" -m pip install --quiet --no-compile --constraint "$(CONSTRAINTS)" --editable '.$(EXTRAS)'
	@touch "$@"
