"""Observations that another process reads: the same, with the same errors."""

import subprocess
import sys

import pytest
from sample_files import export_sample

READ_BESIDE = """
import pathlib, signal, sys
import multiprocessing
from vtff_analysis.tec.reading import begin_reading, prepare_reading

path, expected = pathlib.Path(sys.argv[1]), sys.argv[2]
if len(sys.argv) > 3:
    prepare_reading()
reading = begin_reading(path, "G")
assert reading is not None
if expected == "killed":
    (child,) = multiprocessing.active_children()
    child.kill()
    child.join()
from vtff_gnss.files.observation_files import ObservationFileError, open_observations
try:
    found = reading()
except (OSError, ObservationFileError) as error:
    assert type(error).__name__ == expected, error
    assert path.name in str(error)
    sys.exit()
assert not multiprocessing.active_children()
same = open_observations(path, "G")
assert len(same.table) > 10 and found.format_name == same.format_name
assert set(found.table.columns) == set(same.table.columns)
for name, column in same.table.columns.items():
    assert found.table.columns[name].dtype == column.dtype
    assert found.table.columns[name].tobytes() == column.tobytes(), name
assert (found.table.time_nanoseconds == same.table.time_nanoseconds).all()
"""


@pytest.mark.parametrize("ending", ["read", "killed", "FileNotFoundError", "ObservationFileError"])
@pytest.mark.parametrize("prepared", [[], ["prepared"]])
def test_reading_beside_is_reading(tmp_path, ending, prepared):
    """In a process of its own: tests may have started threads here."""
    path = tmp_path / "absent.rnx"
    if ending in ("read", "killed"):
        path = export_sample(tmp_path)[0]
    elif ending == "ObservationFileError":
        path.write_text("no observations\n")
    done = subprocess.run(
        [sys.executable, "-c", READ_BESIDE, str(path), ending, *prepared],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


def test_a_process_with_threads_is_not_copied():
    program = (
        "import pathlib, threading\n"
        "from vtff_analysis.tec.reading import begin_reading\n"
        "end = threading.Event()\n"
        "threading.Thread(target=end.wait).start()\n"
        "print(begin_reading(pathlib.Path('any.rnx')))\n"
        "end.set()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "None", done.stderr


def test_the_reading_process_ends_with_the_other(tmp_path):
    """Its result is larger than a pipe holds: without a reader it would wait for ever."""
    path = export_sample(tmp_path)[0]
    program = (
        "import multiprocessing, os, pathlib, sys\n"
        "from vtff_analysis.tec.reading import begin_reading\n"
        "reading = begin_reading(pathlib.Path(sys.argv[1]))\n"
        "print(multiprocessing.active_children()[0].pid, flush=True)\n"
        "os._exit(0)\n"
    )
    # The output stays open until the last process that holds it has ended.
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, text=True, timeout=60
    )
    assert int(done.stdout) > 0
    assert not done.stderr


@pytest.mark.parametrize("wanted", [True, False])
def test_a_process_that_was_prepared_in_vain_ends(wanted):
    program = (
        "import multiprocessing, sys\n"
        "from vtff_analysis.tec.reading import begin_reading, prepare_reading\n"
        "prepare_reading()\n"
        "assert multiprocessing.active_children()\n"
        f"if {wanted}:\n"
        "    assert begin_reading(None) is None\n"
        "    assert not multiprocessing.active_children()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
