# Everything a person types. Each target sets up what it needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/installed
RUN_DATA ?= runs
KILLS ?= 100
STATION_KILLS = $(if $(filter file,$(origin KILLS)),200,$(KILLS))
CUTS ?= 50
FUZZ_SECONDS ?= 60
FUZZ_FRAMES ?= 1000000
FUZZ_REPLIES ?= 100000
SEEDS ?= 1000
SECONDS ?= 600
SITE ?= build/site

# Compiled modules are kept, in __pycache__, whatever the environment says: the tests start some three hundred processes,
# and each would compile all of this code anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup run test test-long model-check mutants wire-faults check format docs docs-site golden bench ten-minutes kill-tests station-kills operator-cycles live-browsers seeds power-cuts node-opcua opcua-drill fuzz fuzz-wires test-socketcan coverage-study clean

help:
	@echo "make run     set everything up and test one virtual reducer in real time"
	@echo "make test    set everything up and run the tests"
	@echo "make test-long  the tests that take a whole run or a browser for each case: some minutes more"
	@echo "make model-check  every state that the controller can reach, held against the safety rules: a minute"
	@echo "make mutants every safety row and guard made wrong once: the model check must notice each"
	@echo "make wire-faults  the fault matrix over real wires, on the bench that waits"
	@echo "make check   ruff, mypy and import-linter"
	@echo "make format  format the code"
	@echo "make docs    write the reference pages that are tables of the code, and the JSON Schemas"
	@echo "make docs-site  the documentation as a site with a search, in build/site (SITE=FOLDER); a warning ends it"
	@echo "make golden  make the golden runs anew, after a change of the controller that is meant"
	@echo "make kill-tests  SIGKILL scan and supervisor at 100 random moments each (KILLS=N), nothing may be lost"
	@echo "make station-kills  SIGKILL server and supervisor of a station 200 times (KILLS=N), PostgreSQL stopped for 20 runs: nothing lost or doubled"
	@echo "make operator-cycles  5000 cycles of scan, run and verdict on one page, then restarts of the server: what grows, what is shown"
	@echo "make live-browsers  20 browsers on the live page: the scan with and without them in pairs, the age of the newest point"
	@echo "make node-opcua  node-opcua by npm, for the tests of OPC UA with a client that shares no code with the server"
	@echo "make opcua-drill  100 results by OPC UA to two clients, 20 while all are down, with kills: each has each once"
	@echo "make power-cuts  SIGKILL everything at 50 random moments (CUTS=N), and look at what is found after"
	@echo "make fuzz    coverage-guided fuzzing of every input (FUZZ_SECONDS=N each)"
	@echo "make fuzz-wires  a million bent CAN frames and 100 000 bent Modbus replies into the running controller"
	@echo "make seeds   1000 seeded runs in virtual time (SEEDS=N), each made twice and replayed: the same bytes"
	@echo "make test-socketcan  the CAN driver and the main job on a real SocketCAN bus, in a Linux kernel that runs as a process"
	@echo "make coverage-study  does the stated uncertainty hold? 200 simulated units, 1000 of six types, 40 on the virtual bench; which defects pass: an hour"
	@echo "make bench   performance figures, as ratios measured in one run"
	@echo "make ten-minutes  a long scan over wires with cyclictest beside it (SECONDS=N): periods, records, memory"

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $(STAMP)

setup: $(STAMP)

run: $(STAMP)
	$(BIN)/lostmotion run recipes/rv-40e-121-quick.yaml --serial P1-0001 --data $(RUN_DATA) --report

# Half of what the tests on wires take is waiting: three at a time keep two cores busy, and a bench that waits misses
# nothing. What keeps real time comes after the others, two at a time.
test: $(STAMP)
	$(BIN)/python -m pytest -m "not wall_clock and not long" -n 3 --dist loadfile --no-loadscope-reorder
	$(BIN)/python -m pytest -m "wall_clock and not long" -n 2 --dist loadfile $$(grep -rl wall_clock tests --include='test_*.py')

test-long: $(STAMP)
	$(BIN)/python -m pytest -m long -n 2 --dist loadfile $$(grep -rl "mark.long" tests --include='test_*.py')

model-check: $(STAMP)
	$(BIN)/python tests/proofs/model_check

mutants: $(STAMP)
	$(BIN)/python tests/proofs/model_check mutants

wire-faults: $(STAMP)
	$(BIN)/lostmotion faults matrix --wires --page docs/wire-faults.md

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: $(STAMP)
	$(BIN)/python -m docs.generate

docs-site: $(STAMP)
	$(BIN)/python -m docs.site.build $(SITE)

kill-tests: $(STAMP)
	$(BIN)/python tests/proofs/drills/kill_drill.py $(KILLS)

station-kills: $(STAMP)
	$(BIN)/python tests/proofs/drills/station_kills.py $(STATION_KILLS)

node-opcua:
	npm install --no-audit --no-fund --prefix tests/station/opcua/node

operator-cycles: $(STAMP)
	nice $(BIN)/python -m benchmarks.operator_cycles

live-browsers: $(STAMP)
	$(BIN)/python -m benchmarks.live_browsers
	$(BIN)/python -m benchmarks.live_browsers --sockets

opcua-drill: $(STAMP)
	$(BIN)/python tests/proofs/drills/opcua_drill.py

power-cuts: $(STAMP)
	$(BIN)/python tests/proofs/drills/power_cuts.py $(CUTS)

fuzz: $(STAMP)
	$(BIN)/python -m pip install --quiet --no-compile --no-compile --disable-pip-version-check -c constraints.txt -e '.[dev,fuzz]'
	$(BIN)/python tests/proofs/fuzz/coverage_guided.py $(FUZZ_SECONDS)

fuzz-wires: $(STAMP)
	$(BIN)/python tests/proofs/fuzz/wires.py $(FUZZ_FRAMES) $(FUZZ_REPLIES)

seeds: $(STAMP)
	nice $(BIN)/python tests/proofs/drills/seeds.py $(SEEDS)

golden: $(STAMP)
	$(BIN)/python tests/proofs/golden/regenerate.py

test-socketcan: $(STAMP)
	$(BIN)/python tests/proofs/socketcan/boot.py

coverage-study: $(STAMP)
	$(BIN)/python -m benchmarks.coverage_study
	$(BIN)/python -m benchmarks.coverage_study --types --units 1000 --page docs/coverage.md
	$(BIN)/python -m benchmarks.wrong_pass --before benchmarks/wrong_pass_before.json --page docs/coverage.md
	$(BIN)/python -m benchmarks.virtual_bench_study

bench: $(STAMP)
	$(BIN)/python -m benchmarks

ten-minutes: $(STAMP)
	$(BIN)/python -m benchmarks.ten_minutes --seconds $(SECONDS)

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
