"""Tables of numpy columns: as pyarrow makes them itself, but without pandas."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from vtff_analysis.large_tables import table_of_columns

COLUMNS = {
    "time": np.array(["2024-01-10T00:00:00.001", "1980-01-06"], dtype="datetime64[ms]"),
    "satellite": np.array(["G05", "E1"]),
    "name": np.array(["", "Bel\u00e9m \u2600"]),
    "value": np.array([np.nan, -0.0]),
    "small": np.array([1.5, np.inf], dtype=np.float32),
    "count": np.array([0, 65535], dtype=np.uint16),
    "number": np.array([-1, 2**62]),
}


@pytest.mark.parametrize("rows", [slice(None), slice(0, 0), slice(None, None, -1)])
def test_columns_are_those_of_pyarrow(rows):
    columns = {name: column[rows] for name, column in COLUMNS.items()}
    table, expected = table_of_columns(columns), pa.table(columns)
    table.validate(full=True)
    assert table.schema == expected.schema
    for name in columns:
        # NaN equals NaN in its text, which tells -0.0 from 0.0 too.
        assert repr(table[name].to_pylist()) == repr(expected[name].to_pylist())


def test_pandas_is_not_imported():
    program = (
        "import sys, numpy\n"
        "from vtff_analysis.large_tables import table_of_columns\n"
        "table_of_columns({'a': numpy.arange(3.0), 'b': numpy.array(['x', 'y', 'z'])})\n"
        "sys.exit('pandas' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
