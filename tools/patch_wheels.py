"""Correct two folders of the build machine that the ROS 2 wheels' CMake targets name.

The wheels were built with a Python in ``/opt/python/cp3XX-cp3XX``; their exported
CMake files refer to its headers and to numpy's. Both are replaced by the folders
of this environment. Running it again changes nothing.
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
