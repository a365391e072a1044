"""Without rerun the stand simulates, records and aligns; of a review it says one line."""

import subprocess
import sys

import pytest

WITHOUT = """
import sys
sys.modules["rerun"] = None
from stand.cli.app import main
sys.argv = ["stand", *sys.argv[1:]]
main()
"""


@pytest.mark.slow
def test_a_run_without_rerun(short, tmp_path):
    out = tmp_path / "run"
    command = [sys.executable, "-c", WITHOUT, "run", str(short), "--rate", "5", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in out.iterdir()) == ["result.json", "run.mcap"]
    assert done.stdout.endswith(
        "no review: rerun is not installed (pip install 'rerun-sdk>=0.41,<0.42')\n"
    )
    assert done.stderr == ""
