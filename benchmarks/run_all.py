"""Run every benchmark in this folder, one after the other."""

from __future__ import annotations

import pathlib
import subprocess
import sys


def main() -> int:
    """Return the number of benchmarks that could not be run."""
    failed = 0
    for path in sorted(pathlib.Path(__file__).parent.glob("bench_*.py")):
        print(f"\n## {path.stem}", flush=True)
        failed += subprocess.run([sys.executable, str(path)], check=False).returncode != 0
    return failed


if __name__ == "__main__":
    sys.exit(main())
