"""The dip equator lies where it is published, and the field is level on it."""

import numpy as np
import pytest

from vtff_dynamics.attitude.dip_equator import dip_equator
from vtff_dynamics.attitude.magnetic_field import magnetic_field_gcrf
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_dynamics.time.timescales import GpsTime

TIME = GpsTime.from_week_tow(2086, 259_200.0)  # 2020-01-01


def test_it_lies_where_it_is_published():
    """At 75 deg west it is south of the equator by 12 deg (Jicamarca), over Africa north of it."""
    points = dip_equator(TIME, 110e3)
    latitude = dict(np.round(points, 6).tolist())
    assert latitude[-75.0] == pytest.approx(-12.0, abs=1.5)
    assert latitude[20.0] == pytest.approx(10.0, abs=2.0)
    assert latitude[-180.0] == pytest.approx(latitude[180.0], abs=0.01)


def test_the_field_is_level_on_it():
    for longitude, latitude in dip_equator(TIME, 350e3, 9):
        place = itrf_from_geodetic([np.radians(latitude), np.radians(longitude), 350e3])
        rotation = rotation_gcrf_to_itrf(TIME)
        field = rotation @ magnetic_field_gcrf(TIME, rotation.T @ place)
        up = place / np.linalg.norm(place)  # geocentric: up to 0.2 deg off the vertical
        assert abs(field @ up) / np.linalg.norm(field) < 0.006


def test_a_time_without_a_field_is_refused():
    with pytest.raises(ValueError, match=r"^time: .*IGRF-14 holds from 1900 to 2030"):
        dip_equator(GpsTime.from_week_tow(2700, 0.0), 350e3)
