"""Lever arms, phase centres and attitude of the antennas in relative navigation."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vtff_dynamics.frames.earth import (
    rotation_gcrf_to_itrf,
    state_gcrf_to_itrf,
    state_itrf_to_gcrf,
)
from vtff_dynamics.frames.geodetic import rotation_itrf_to_enu
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.antex import PhaseCentre, PhaseCentreMap
from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GPS
from vtff_nav.relative.common.antenna_correction import (
    ATTITUDE_FRAMES,
    Antenna,
    AntennaPair,
    check_frequencies,
)
from vtff_nav.relative.common.body_attitude import BodyAttitude
from vtff_nav.relative.common.estimator_inputs import EstimatorInputs

TIME = parse_epoch("2016-03-21T01:00:00 GPS")
STATE_GCRF = np.array([4.9e6, 3.1e6, 3.8e6, -4.1e3, 6.2e3, 0.2e3])
STATE_ITRF = state_gcrf_to_itrf(TIME, STATE_GCRF)


def flat_map(*offset: float) -> PhaseCentreMap:
    """Return a map with an offset and no variation."""
    zenith = np.radians([0.0, 90.0])
    return PhaseCentreMap(np.array(offset), zenith, np.zeros(1), np.zeros((1, 2)))


def test_body_axes_are_those_of_the_frame() -> None:
    """Against rotations that are computed another way."""
    down = Antenna().rotation_body_to_itrf(TIME, STATE_ITRF)
    east, north, up = rotation_itrf_to_enu(STATE_ITRF[:3])
    np.testing.assert_allclose(down, np.column_stack((north, east, -up)), atol=1e-12)

    for frame, axes_gcrf in (("rtn", rotation_gcrf_to_rtn(STATE_GCRF)), ("gcrf", np.eye(3))):
        rotation = Antenna(attitude_frame=frame).rotation_body_to_itrf(TIME, STATE_ITRF)  # type: ignore[arg-type]
        for axis, axis_gcrf in zip(rotation.T, axes_gcrf, strict=True):
            # A vector turns as the difference of two positions at one time does.
            moved = np.concatenate((STATE_ITRF[:3] + axis, np.zeros(3)))
            still = np.concatenate((STATE_ITRF[:3], np.zeros(3)))
            turned = state_itrf_to_gcrf(TIME, moved) - state_itrf_to_gcrf(TIME, still)
            np.testing.assert_allclose(turned[:3], axis_gcrf, atol=1e-8)


def test_quaternion_turns_body_to_frame() -> None:
    """A quarter turn about z: x of the body is east."""
    quarter = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
    east = rotation_itrf_to_enu(STATE_ITRF[:3])[0]
    turned = Antenna(quaternion=quarter).rotation_body_to_itrf(TIME, STATE_ITRF)
    np.testing.assert_allclose(turned[:, 0], east, atol=1e-12)


def test_quaternion_needs_no_unit_length() -> None:
    """Against scipy, whose quaternions have the scalar last, too."""
    quaternion = (0.3, -0.8, 1.1, 2.0)
    turned = Antenna(quaternion=quaternion).rotation_body_to_itrf(TIME, STATE_ITRF)
    level = Antenna().rotation_body_to_itrf(TIME, STATE_ITRF)
    np.testing.assert_allclose(
        level.T @ turned, Rotation.from_quat(quaternion).as_matrix(), atol=1e-12
    )


@pytest.mark.parametrize("frame", ATTITUDE_FRAMES)
def test_columns_are_derivatives_of_ranges(frame: str) -> None:
    """Ranges from the reference points change by the columns when lever arms do."""
    quaternion = tuple(Rotation.from_euler("ZYX", [0.3, -0.4, 0.5]).as_quat().tolist())
    states = np.stack((STATE_ITRF, STATE_ITRF + np.array([250.0, 30.0, 20.0, 0.0, 0.0, 0.0])))
    satellites = STATE_ITRF[:3] * 3.9 + np.array([[1e7, 0, 0], [0, -2e7, 3e6], [5e6, 5e6, 1e7]])

    def differences(errors: np.ndarray) -> np.ndarray:
        pair = AntennaPair(
            *(
                Antenna(tuple(0.1 + error), 0.2, attitude_frame=frame, quaternion=quaternion)  # type: ignore[arg-type]
                for error in errors.reshape(2, 3)
            )
        )
        antennas = pair.states_itrf(states, pair.rotations_body_to_itrf(TIME, states))
        ranges = np.linalg.norm(satellites - antennas[:, None, :3], axis=2)
        return np.asarray(ranges[1] - ranges[0])

    pair = AntennaPair(
        Antenna(lever_arm_sigma=0.2, attitude_frame=frame, quaternion=quaternion),  # type: ignore[arg-type]
        Antenna(lever_arm_sigma=0.3, attitude_frame=frame, quaternion=quaternion),  # type: ignore[arg-type]
    )
    directions = satellites - states[1, :3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    columns = pair.offset_columns(directions, pair.rotations_body_to_itrf(TIME, states))
    step = 0.5
    for axis, column in enumerate(columns.T):
        error = np.zeros(6)
        error[axis] = step
        change = (differences(error) - differences(-error)) / (2.0 * step)
        np.testing.assert_allclose(change, column, atol=3e-5)
    assert list(pair.offset_variances().values()) == [0.2**2] * 3 + [0.3**2] * 3


def test_only_uncertain_offsets_are_states() -> None:
    pair = AntennaPair(Antenna((1.0, 0.0, 0.0)), Antenna(lever_arm_sigma=0.1))
    assert [label[1] for label in pair.offset_variances()] == [1, 1, 1]
    mapped = AntennaPair(Antenna(phase_map_sigma=0.003), Antenna(lever_arm_sigma=0.004))
    assert list(mapped.offset_variances().values()) == pytest.approx([9e-6] * 3 + [16e-6] * 3)
    assert Antenna(lever_arm_sigma=0.004, phase_map_sigma=0.003).offset_sigma == 0.005
    rotations = pair.rotations_body_to_itrf(TIME, np.stack((STATE_ITRF, STATE_ITRF)))
    assert pair.offset_columns(np.eye(3), rotations).shape == (3, 3)
    assert AntennaPair().offset_columns(np.eye(3), rotations).shape == (3, 0)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"lever_arm_body": (1.0, 2.0)}, "lever_arm: three numbers"),
        ({"lever_arm_body": (1.0, 2.0, float("nan"))}, "lever_arm: three numbers"),
        ({"lever_arm_sigma": -0.1}, "lever_arm_sigma: 0 m or more"),
        ({"phase_map_sigma": float("nan")}, "phase_map_sigma: 0 m or more"),
        ({"attitude_frame": "lvlh"}, "attitude_frame: one of north_east_down, rtn, gcrf"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "quaternion: four numbers"),
        ({"quaternion": (0.0, 0.0, 1.0)}, "quaternion: four numbers"),
    ],
)
def test_wrong_antennas_are_refused(fields: dict[str, object], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Antenna(**fields)  # type: ignore[arg-type]


def test_antenna_without_a_carrier_that_is_used_is_refused() -> None:
    antenna = Antenna(phase_centre=PhaseCentre("PATCH NONE", {"G01": flat_map(0.0, 0.0, 0.1)}))
    check_frequencies(antenna, {SYSTEM_GPS: (1,)})
    check_frequencies(Antenna(), {SYSTEM_GALILEO: (1,)})
    with pytest.raises(ValueError, match="'PATCH NONE' has no frequency G02"):
        check_frequencies(antenna, {SYSTEM_GPS: (1, 2)})
    with pytest.raises(ValueError, match="has no frequency E01"):
        check_frequencies(antenna, {SYSTEM_GALILEO: (1,)})


def estimated(time, lever_arm=(0.3, -0.2, 0.4), variances=(1e-6, 2e-6, 3e-6)):
    """Return an antenna on a body of estimated attitude, and that attitude."""
    antenna = Antenna(lever_arm_body=lever_arm, attitude_frame="estimated")
    quaternion = Rotation.random(random_state=4).as_quat()
    rate = np.array([1e-3, -2e-3, 3e-3])
    return antenna, BodyAttitude(time, quaternion, rate, np.diag(variances))


def test_an_estimated_attitude_turns_on_with_its_rate() -> None:
    """Against scipy, 20 s after the estimate."""
    antenna, attitude = estimated(TIME - 20.0)
    turned = antenna.rotation_body_to_itrf(TIME, STATE_ITRF, attitude)
    now = Rotation.from_quat(attitude.quaternion_gcrf) * Rotation.from_rotvec(
        20.0 * attitude.rate_body
    )
    np.testing.assert_allclose(turned, rotation_gcrf_to_itrf(TIME) @ now.as_matrix(), atol=1e-12)
    level = antenna.rotation_body_to_itrf(TIME, STATE_ITRF)
    np.testing.assert_allclose(level, Antenna().rotation_body_to_itrf(TIME, STATE_ITRF))


def test_error_of_an_attitude_moves_the_antenna_across_its_lever_arm() -> None:
    """The derivative of a single difference against a body that is turned by a small angle."""
    antenna, attitude = estimated(TIME)
    directions = np.array([[0.6, 0.0, 0.8], [0.0, -0.8, 0.6]])
    for receiver, sign in ((0, -1.0), (1, 1.0)):  # deputy less chief
        pair = AntennaPair(*(antenna if index == receiver else Antenna() for index in (0, 1)))
        rotation = antenna.rotation_body_to_itrf(TIME, STATE_ITRF, attitude)
        columns = pair.attitude_columns(
            directions, np.array([rotation, rotation]), (attitude, attitude)
        )
        for axis in range(3):
            small = 1e-6 * np.eye(3)[axis]
            moved = rotation @ (Rotation.from_rotvec(small).apply(antenna.lever_arm_body))
            moved = moved - rotation @ antenna.lever_arm_body
            change = -sign * directions @ moved  # a range shrinks as its antenna comes nearer
            np.testing.assert_allclose(1e-6 * columns[:, axis], change, atol=1e-12)
        known = pair.attitude_variances((attitude, attitude))
        assert list(known) == [("attitude_error", receiver, axis) for axis in range(3)]
        assert list(known.values()) == [1e-6, 2e-6, 3e-6]
        unknown = pair.attitude_variances((None, None))
        assert min(unknown.values()) >= 1.0
        # Where the attitude is not known the antenna may be anywhere about the centre of mass.
        columns = pair.attitude_columns(directions, np.array([rotation, rotation]), (None, None))
        length = np.linalg.norm(antenna.lever_arm_body)
        np.testing.assert_allclose(np.linalg.norm(columns, axis=1), length)


def test_a_body_that_turns_about_two_axes_has_not_turned_against_its_estimates() -> None:
    """Exact attitudes every 5 s of a body that turns once an orbit about z and about an axis."""
    rate, inertial = 1.06e-3, np.array([0.0, 1.0, 0.0])

    def attitude(second: float) -> BodyAttitude:
        about_z = Rotation.from_rotvec([0.0, 0.0, rate * second])
        turned = Rotation.from_rotvec(rate * second * inertial) * about_z
        rate_body = rate * (about_z.inv().apply(inertial) + np.array([0.0, 0.0, 1.0]))
        return BodyAttitude(TIME + second, turned.as_quat(), rate_body, 1e-6 * np.eye(3))

    turns = [
        attitude(second).turn_from(attitude(second - 5.0), TIME + second + 1.0)
        for second in np.arange(5.0, 605.0, 5.0)
    ]
    assert np.abs(np.sum(turns, axis=0)).max() < 1e-5
    off = Rotation.from_rotvec([0.0, 2e-3, 0.0])
    later = attitude(5.0)
    later = dataclasses.replace(
        later, quaternion_gcrf=(Rotation.from_quat(later.quaternion_gcrf) * off).as_quat()
    )
    turn = later.turn_from(attitude(0.0), TIME + 5.0)
    np.testing.assert_allclose(turn, [0.0, 2e-3, 0.0], atol=1e-7)


def test_corrections_that_an_estimator_tells_count_those_of_attitudes_between_too() -> None:
    """Where it does not tell one of them the attitudes themselves are compared."""
    antenna, first = estimated(TIME)
    pair, told = AntennaPair(deputy=antenna), np.array([1e-3, 0.0, -2e-3])
    inputs = EstimatorInputs()
    inputs.add_attitude(first)
    for number in (1, 2):
        turned = Rotation.from_quat(first.quaternion_gcrf) * Rotation.from_rotvec(
            5.0 * number * first.rate_body + [0.0, 0.0, 4e-3 * number]
        )
        inputs.add_attitude(
            dataclasses.replace(
                first,
                time=TIME + 5.0 * number,
                quaternion_gcrf=turned.as_quat(),
                correction=told * number,
            )
        )

    def turn(before: float, now: float) -> list[float]:
        attitudes = [inputs._attitudes_at(TIME + second) for second in (before, now)]
        corrections = inputs._corrections_since(attitudes[0], attitudes[1])
        return list(pair.attitude_turns(TIME + now, *attitudes, corrections).values())

    np.testing.assert_allclose(turn(1.0, 2.0), 0.0)
    np.testing.assert_allclose(turn(6.0, 11.0), 2.0 * told)
    np.testing.assert_allclose(turn(1.0, 11.0), 3.0 * told)
    assert turn(-1.0, 1.0) == []
    newest = dataclasses.replace(inputs._attitudes_at(TIME + 11.0)[1], time=TIME + 10.5)
    inputs.add_attitude(dataclasses.replace(newest, correction=np.full(3, np.nan)))
    expected = -0.5 * first.rate_body  # it has not turned as it should have in half a second
    np.testing.assert_allclose(turn(6.0, 12.0)[:2], expected[:2], atol=1e-4)
    with pytest.raises(ValueError, match="correction: three numbers"):
        dataclasses.replace(first, correction=np.zeros(2))


def test_an_attitude_counts_from_the_next_epoch_on_and_not_for_ever() -> None:
    """Whether it comes before or after the observations of its own time changes nothing."""
    inputs = EstimatorInputs()
    _, attitude = estimated(TIME)
    inputs.add_attitude(attitude)
    assert inputs._attitudes_at(TIME) == (None, None)
    assert inputs._attitudes_at(TIME + 1.0) == (None, attitude)
    assert inputs._attitudes_at(TIME + 61.0) == (None, None)
    inputs.add_attitude(attitude, is_of_chief=True)
    assert inputs._attitudes_at(TIME + 60.0) == (attitude, attitude)
    with pytest.raises(ValueError, match="covariance"):
        BodyAttitude(TIME, attitude.quaternion_gcrf, attitude.rate_body, np.zeros(3))


@pytest.mark.parametrize(
    ("row", "column", "value", "text"),
    [
        (1, 1, -1e-9, "variances 0 or more"),
        (0, 1, 1e-7, "symmetric"),
        (0, 1, float("nan"), "finite"),
        (2, 2, float("inf"), "finite"),
    ],
)
def test_wrong_covariances_of_attitudes_are_refused(row, column, value, text) -> None:
    _, attitude = estimated(TIME)
    covariance = attitude.covariance.copy()
    covariance[row, column] = value
    with pytest.raises(ValueError, match=text):
        dataclasses.replace(attitude, covariance=covariance)


def test_correlations_beyond_one_are_refused() -> None:
    _, attitude = estimated(TIME)
    covariance = attitude.covariance + 2e-6 * (np.ones((3, 3)) - np.eye(3))
    with pytest.raises(ValueError, match="no correlation beyond 1"):
        dataclasses.replace(attitude, covariance=covariance)
