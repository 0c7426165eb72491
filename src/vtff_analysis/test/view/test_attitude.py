"""Attitude in the viewer: against the axes of the spacecraft's own orbit."""

import numpy as np
import pytest

pytest.importorskip("brahe")

from vtff_analysis.view.attitude import attitude_row
from vtff_analysis.view.scene import COLUMNS
from vtff_dynamics.attitude.orbit_axes import (
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.quaternion import rotation_matrix
from vtff_dynamics.time.timescales import parse_epoch

STATE = np.array([7.0e6, 1.0e5, -3.0e5, 100.0, 5.0e3, 5.5e3])
STAMP = parse_epoch("2024-03-20T00:00:00 UTC").to_unix_nanoseconds()


def row(roll, pitch, yaw, stamp=STAMP):
    orbit = rotation_gcrf_to_orbit(STATE)
    quaternion = quaternion_from_roll_pitch_yaw(roll, pitch, yaw, orbit)
    values = attitude_row(stamp, quaternion, (0.01, 0.0, -0.02), STATE)
    return dict(zip(COLUMNS["attitude"], [*values, 0.0], strict=True))


def axes_rtn(sample):
    """Body axes in RTN as columns, as the page turns them."""
    return rotation_matrix(np.array([sample[name] for name in ("qx", "qy", "qz", "qw")]))


def test_a_body_that_points_has_its_z_axis_down_and_x_ahead():
    np.testing.assert_allclose(
        axes_rtn(row(0.0, 0.0, 0.0)), [[0, 0, -1], [1, 0, 0], [0, -1, 0]], atol=1e-12
    )


@pytest.mark.parametrize(("name", "axis"), [("roll_deg", 0), ("pitch_deg", 1), ("yaw_deg", 2)])
def test_an_angle_turns_about_its_own_axis(name, axis):
    angles = [0.0, 0.0, 0.0]
    angles[axis] = 0.3
    sample = row(*angles)
    assert sample[name] == pytest.approx(np.degrees(0.3))
    still = axes_rtn(row(0.0, 0.0, 0.0))
    turned = axes_rtn(sample)
    np.testing.assert_allclose(turned[:, axis], still[:, axis], atol=1e-12)
    other = (axis + 1) % 3
    assert turned[:, other] @ still[:, other] == pytest.approx(np.cos(0.3))
    assert turned[:, other] @ still[:, (axis + 2) % 3] == pytest.approx(np.sin(0.3))


def test_rates_are_degrees_and_the_field_is_a_direction():
    sample = row(0.1, -0.2, 2.0)
    assert sample["rate_z_deg"] == pytest.approx(np.degrees(-0.02))
    field = [sample[f"field_{axis}"] for axis in ("radial", "in_track", "cross_track")]
    assert np.linalg.norm(field) == pytest.approx(1.0)
    late = row(0.0, 0.0, 0.0, parse_epoch("2036-01-01T00:00:00 UTC").to_unix_nanoseconds())
    assert np.isnan(late["field_radial"])  # IGRF-14 does not hold there
