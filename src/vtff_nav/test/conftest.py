"""Make the helper modules of this folder importable whatever import mode pytest uses."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
