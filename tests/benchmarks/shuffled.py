"""A pytest plugin: the files in another order, and the tests of each; no order may matter.

``PYTHONPATH=tests python -m pytest -p benchmarks.shuffled --shuffled 3``
"""

import random
from itertools import groupby


def pytest_addoption(parser) -> None:
    parser.addoption("--shuffled", type=int, default=1, help="seed of the order of tests")


def pytest_collection_modifyitems(config, items) -> None:
    """By files, so that what a file sets up once is set up once."""
    order = random.Random(config.getoption("--shuffled"))
    files = [list(own) for _, own in groupby(items, key=lambda item: item.path)]
    for own in files:
        order.shuffle(own)
    order.shuffle(files)
    items[:] = [item for own in files for item in own]
