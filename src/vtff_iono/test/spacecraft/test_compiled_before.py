"""The ionosphere of a formation is compiled before its first second."""

import subprocess
import sys

COMPILED_BEFORE_THE_FIRST_SECOND = """
from compiled_forms import compiled_forms
from formation_drawing import DrawnFormation, layer
from vtff_iono.formation_ionosphere import FormationIonosphere
from vtff_iono.synthetic_seconds import process_synthetic_seconds

drawn = DrawnFormation(lambda t: 300e3 + 3e3 * t, layer())
seconds = list(drawn.seconds(12.0, 0.5))
process_synthetic_seconds(FormationIonosphere())
before = compiled_forms()
formation = FormationIonosphere()
for ephemeris in drawn.ephemerides(12.0):
    formation.add_ephemeris(ephemeris)
results = [formation.process(second) for second in seconds]
densities = [density.epoch.density for result in results for density in result.density[0]]
assert sum(density > 0.0 for density in densities) > 5, densities
after = compiled_forms()
assert len(before) > 10 and after == before, (before, after)
"""


def test_nothing_is_left_to_compile_for_the_first_second():
    """In a process of its own: other tests have compiled everything here."""
    program = f"import sys; sys.path[:0] = {sys.path!r}\n{COMPILED_BEFORE_THE_FIRST_SECOND}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
