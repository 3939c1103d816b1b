# make demo [WORLD=path] [ROBOT=urdf]   the main job on examples/office, or on your own world
# make test                the tests, one process more than cores
# make test-docker         those that need a Docker engine
# make soak                server and clients are killed 50 times, SEMMAP_KILLS=1000 for more; ten power cuts; a full
#                          and a slow disk; a clock that jumps; readers and writers of fields for ten minutes; missions that are killed
# make failover            100 failures of servers in Docker, under load; SEMMAP_ROUNDS=8 for fewer
# make growth              100,000 moves of an object; SEMMAP_GROWTH_MOVES=864000 for a day of ten a second
# make fuzz                damaged and random inputs for all readers, languages and native functions, four minutes;
#                          SEMMAP_FUZZ_SECONDS=3600 make fuzz for an hour, SEMMAP_FUZZ_CASES=1000000 for so many
# make fuzz-sanitized      the native functions, built with address and undefined-behaviour sanitizers
# make explore             the property tests again, with examples that no run has had
# make lint                ruff, mypy, import-linter, clang-format
# make newest              the newest libraries that pyproject.toml allows: which changed, and the tests with them
# make audit               known vulnerabilities of the libraries that are installed; needs the advisories of PyPI
# make docs                the pages as HTML: build/docs
# make bench               the speed tables
# make clean               what these left

OFFICE = examples/office
WORLD ?= $(OFFICE)/office.sdf $(OFFICE)/office_rooms.geojson
ROBOT ?= $(OFFICE)/delivery_robot.urdf --parts $(OFFICE)/delivery_robot_parts.yaml
.PHONY: docs demo test test-docker soak failover growth fuzz fuzz-sanitized explore lint newest audit bench clean

demo:
	@scripts/setup viewer
	@.venv/bin/semmap demo $(WORLD) --robot $(ROBOT)

test: export PYTHONDONTWRITEBYTECODE =  # else each run compiles the tests anew, ten seconds a worker
test:
	@scripts/setup test
	@.venv/bin/python -m pytest -q -n auto --dist loadfile --no-loadscope-reorder

test-docker:
	@FEW=1 scripts/setup test
	@.venv/bin/python -m pytest -q -m docker tests/database tests/examples tests/failover tests/migrations

soak:
	@scripts/setup test
	@.venv/bin/python -m tests.soak
	@SEMMAP_SOAK=600 .venv/bin/python -m pytest -q tests/fields/sources/test_manager.py \
		tests/planner/mission/test_kills.py tests/planner/mission/test_claims.py \
		tests/model/test_isolation.py tests/schema/test_hostile_robot.py

failover:
	@scripts/setup test
	@.venv/bin/python -m tests.failover

growth:
	@scripts/setup test
	@.venv/bin/python -m tests.growth

fuzz:
	@scripts/setup test
	@.venv/bin/python -m tests.fuzz

fuzz-sanitized:
	@scripts/setup test
	@.venv/bin/pip install -q --disable-pip-version-check --no-deps --upgrade --target build/sanitized \
		-C build-dir=build/sanitized-tree -C cmake.build-type=RelWithDebInfo -C cmake.define.SEMMAP_SANITIZE=ON .
	@SEMMAP_FUZZ_MODULES=build/sanitized .venv/bin/python -m tests.fuzz --kinds native

explore:
	@scripts/setup test
	@HYPOTHESIS_PROFILE=explore .venv/bin/python -m pytest -q -m "hypothesis or explore"

lint:
	@FEW=1 scripts/setup test lint
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/lint-imports
	find native -name '*.?pp' | xargs .venv/bin/clang-format --dry-run --Werror

newest:
	@scripts/lock
	@git diff -U0 requirements | grep '^[+-][A-Za-z]' || echo "no library has a newer version"
	@$(MAKE) test

audit:
	@[ -x build/audit/bin/pip-audit ] || { python3 -m venv build/audit && build/audit/bin/pip install -q pip-audit; }
	@cat $(filter-out requirements/r2rml.txt, $(wildcard requirements/*.txt)) | sed '/^ /d; s/ \\$$//' | sort -u >build/audit/all.txt
	@sed '/^ /d; s/ \\$$//' requirements/r2rml.txt >build/audit/r2rml.txt
	@for each in all r2rml; do build/audit/bin/pip-audit --strict --disable-pip --no-deps -r build/audit/$$each.txt || exit 1; done

bench:  # a peer needs another pandas than the locked one: the next call of scripts/setup installs that again
	@scripts/setup test bench
	@.venv/bin/python -m benchmarks; ended=$$?; rm -f .venv/.setup-test .venv/.setup-dependencies .venv/.setup-bench; exit $$ended

docs:
	@scripts/setup docs
	@.venv/bin/python scripts/reference
	@.venv/bin/mkdocs build -q
	@echo build/docs/index.html

clean:
	rm -rf build out .pytest_cache .mypy_cache .ruff_cache .hypothesis
