"""The ionosphere of a formation is compiled before its first second."""

import subprocess
import sys

COMPILED_BEFORE_THE_FIRST_SECOND = """
import gc
from formation_drawing import DrawnFormation, layer
from numba.core.registry import CPUDispatcher
from vtff_iono.formation_ionosphere import FormationIonosphere, compile_kernels

def signatures():
    return {
        item.py_func.__module__ + "." + item.py_func.__qualname__: len(item.signatures)
        for item in gc.get_objects()
        if isinstance(item, CPUDispatcher) and item.signatures
    }

drawn = DrawnFormation(lambda t: 300e3 + 3e3 * t, layer())
seconds = list(drawn.seconds(12.0, 0.5))
compile_kernels()
before = signatures()
formation = FormationIonosphere()
for ephemeris in drawn.ephemerides(12.0):
    formation.add_ephemeris(ephemeris)
results = [formation.process(second) for second in seconds]
densities = [density.epoch.density for result in results for density in result.density[0]]
assert sum(density > 0.0 for density in densities) > 5, densities
assert len(before) > 15 and signatures() == before, (before, signatures())
"""


def test_nothing_is_left_to_compile_for_the_first_second():
    """In a process of its own: other tests have compiled everything here."""
    program = f"import sys; sys.path[:0] = {sys.path!r}\n{COMPILED_BEFORE_THE_FIRST_SECOND}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
