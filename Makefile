.PHONY: demo test lint bench peers proof docs mutants survive fuzz clean

VENV := .venv
PEERS := .venv-peers
PY := $(VENV)/bin/python
READY := $(VENV)/.ready

demo: $(READY)
	$(VENV)/bin/stand run six-position --force

test: $(READY)
	$(PY) -m pytest --numprocesses auto $(ARGS)

lint: $(READY)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m pyright

bench: $(READY)
	OPENBLAS_NUM_THREADS=1 $(PY) tests/benchmarks/bench.py $(ARGS)

peers: $(READY) $(PEERS)/.ready
	$(PY) tests/benchmarks/peers.py $(PEERS)/bin/python

$(PEERS)/.ready:
	python3 -m venv $(PEERS)
	$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check \
		'python-ins==1.0.1' 'scipy<1.17' 'ahrs==0.4.0' 'allantools>=2024.6'
	touch $@

proof: $(READY)
	$(PY) tests/benchmarks/proof.py
	$(PY) tests/benchmarks/proof_allan.py
	$(PY) tests/benchmarks/proof_nees.py
	$(PY) tests/benchmarks/proof_drives.py
	$(PY) tests/benchmarks/proof_units.py
	$(PY) tests/benchmarks/proof_calibration.py

docs: $(READY)
	$(PY) -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	$(PY) tools/site/build.py $(ARGS)

mutants: $(READY)
	$(PY) -m pip install --quiet --disable-pip-version-check --editable '.[mutants]'
	$(PY) tests/benchmarks/mutants.py $(ARGS)

survive: $(READY)
	STAND_DISK_SWEEP=1 STAND_KILLS=50 STAND_KERNELS=all STAND_INTERRUPTS=20 $(PY) -m pytest -q \
		tests/stand/test_full_disk.py tests/stand/test_recovered.py tests/test_any_processor.py \
		tests/stand/cli/test_interrupts.py

fuzz: $(READY)
	$(PY) tests/benchmarks/fuzz.py

$(READY): pyproject.toml
	python3 -m venv $(VENV)
	$(PY) -m pip install --quiet --disable-pip-version-check --upgrade pip
	$(PY) -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) $(PEERS) build dist .pytest_cache .ruff_cache .hypothesis
