"""Settings of all tests: where helper modules are found, and the examples of property tests."""

import os
import pathlib
import sys

from hypothesis import settings

# Helper modules of the tests stand in the test folders; pytest's importlib mode adds no path.
_ROOT = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(_ROOT / "test"), *(str(path) for path in sorted(_ROOT.glob("src/*/test")))]

# A test that fails by chance tells nothing of the change that it is run for. New examples are
# looked for on purpose, with HYPOTHESIS_PROFILE=explore.
settings.register_profile("vtff", deadline=None, derandomize=True, database=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "vtff"))
