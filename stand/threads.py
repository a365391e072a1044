"""Threads of linear algebra: one, in processes that are ours alone.

OpenBLAS wakes a thread per core for products of small matrices and lets them wait for more: `fine`
and rehearsals are never sooner by it, take twice the processor, and longer beside other work.
"""

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def set_one_thread() -> None:
    """Linear algebra of this process has one thread, if nobody asked for another number.

    For programs, before numpy is imported: a library leaves the environment as it is. What OMP is
    told is left alone, as it is said of threads of ours too (`stand.simulation.simulation`).
    """
    if not any(name in os.environ for name in VARIABLES):
        os.environ.update({name: "1" for name in VARIABLES if name != "OMP_NUM_THREADS"})
