"""Damaged logs and texts by the thousand: `make fuzz`. Each kind in a process of its own.

python tests/benchmarks/fuzz.py [CASES [SEED [KIND ...]]]
"""

import multiprocessing
import resource
import sys
import tempfile
import time
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

LOGS = ("text", "MCAP", "bag", "npy", "npz", "mat")
TEXTS = ("TOML", "planned", "metadata", "result", "columns")
KINDS = (*LOGS, *TEXTS)


def fuzz(kind: str, cases: int, seed: int) -> None:
    """One kind, and a line of what came of it."""
    import fuzzed

    warnings.simplefilter("error")
    begin = time.perf_counter()
    folder = Path(tempfile.mkdtemp(prefix="fuzz"))
    found = fuzzed.run(kind, cases, folder, seed)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{kind}: {cases} cases, {found['read']} read, {found['refused']} refused in one line; "
        f"{time.perf_counter() - begin:.0f} s, at most {peak:.0f} MB",
        flush=True,
    )


def main() -> int:
    """Exit code 1 if any kind failed."""
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    failed, context = [], multiprocessing.get_context("spawn")
    for kind in sys.argv[3:] or KINDS:
        process = context.Process(target=fuzz, args=(kind, cases, seed))
        process.start()
        process.join()
        failed += [kind] if process.exitcode else []
    print(f"failed: {', '.join(failed)}" if failed else "all hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
