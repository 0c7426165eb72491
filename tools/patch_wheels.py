"""Correct two folders of the build machine that the ROS 2 wheels' CMake targets name.

This is the one place that changes anything in a wheel, and `make setup` calls it after each
installation of packages.

Why: the wheels were built with a Python in ``/opt/python/cp3XX-cp3XX``. The CMake files of the
wheels (``.venv/share/*/cmake``) refer to the headers of that Python and of its numpy, which no
other machine has; the messages of vtff_msgs would not compile. Both are replaced by the folders of
this environment. Running the script again changes nothing.

When a wheel changes (a new version in ``requirements/lock.txt``):

1. ``make clean setup``. If the workspace builds, nothing is to be done.
2. If CMake or the compiler names a folder that does not exist, look for it:
   ``grep -rhoE '/opt/[^;" ]*' .venv/share --include=*.cmake | sort -u``. A folder of the build
   machine that is not covered below gets a pattern beside the two.
3. If it patches no file in a fresh set-up, the wheels no longer need it: remove it and its call
   in ``tools/setup.sh``.

`tools/write_environment.py` is the other piece that knows the wheels: it names the folders of their
shared libraries (``ros_*.libs``), so that no process has to start twice to find them.
"""

from __future__ import annotations

import pathlib
import re
import sys
import sysconfig

import numpy

BUILD_MACHINE_PYTHON = r"/opt/python/cp3\d+-cp3\d+"


def main() -> None:
    """Rewrite the CMake files of this environment."""
    share = pathlib.Path(sys.prefix) / "share"
    numpy_include = re.compile(
        BUILD_MACHINE_PYTHON + r"/lib/python3\.\d+/site-packages/numpy/_?core/include"
    )
    python_include = re.compile(BUILD_MACHINE_PYTHON + r"/include/python3\.\d+")
    changed = 0
    for path in share.rglob("*.cmake"):
        text = path.read_text(encoding="utf-8")
        patched = numpy_include.sub(numpy.get_include(), text)
        patched = python_include.sub(sysconfig.get_paths()["include"], patched)
        if patched != text:
            path.write_text(patched, encoding="utf-8")
            changed += 1
    print(f"patched {changed} CMake files of the ROS 2 wheels")


if __name__ == "__main__":
    main()
