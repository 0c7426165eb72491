"""Lets the tests import their shared modules from this folder in pytest's importlib mode."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
