"""Settings of all tests: property tests draw the same examples in every run."""

import os

from hypothesis import settings

# A test that fails by chance tells nothing of the change that it is run for. New examples are
# looked for on purpose, with HYPOTHESIS_PROFILE=explore.
settings.register_profile("vtff", deadline=None, derandomize=True, database=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "vtff"))
