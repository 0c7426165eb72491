"""The node relative_ekf where its inputs are wrong."""

from __future__ import annotations

import functools
import math
import pathlib
from collections.abc import Iterator

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from cdgps_test_support import START, Scenario, simulate  # noqa: E402
from geometry_msgs.msg import AccelStamped  # noqa: E402
from node_bench import NodeBench  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from vtff_dynamics.time.timescales import GpsTime  # noqa: E402
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch  # noqa: E402
from vtff_msgs.msg import (  # noqa: E402
    AmbiguityStatus,
    GnssObservations,
    RelativeState,
    SlantTec,
)
from vtff_nav.relative.shipped_estimators import make_cdgps  # noqa: E402
from vtff_nav.relative_ekf_node import (  # noqa: E402
    RelativeEkfNode,
    RelativeEkfParameters,
    antenna_pair,
    estimator_setting,
)
from vtff_node import qos  # noqa: E402
from vtff_node.conversions.gnss import ephemeris_to_message  # noqa: E402
from vtff_node.parameters import ParameterError  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402

SECOND = 10**9
EPOCH = 1_458_521_983 * SECOND


class Bench(NodeBench):
    """The node, and publishers of its thrust and clock."""

    def __init__(self, context: rclpy.Context, **parameters: object) -> None:
        super().__init__(context, RelativeEkfNode, **parameters)
        self.thrust = self.probe.create_publisher(
            AccelStamped, "/deputy/propulsion/thrust_applied", qos.PUBLISH
        )
        self.clock = self.probe.create_publisher(Clock, "/clock", qos.PUBLISH)
        self.states: list[RelativeState] = []
        self.probe.create_subscription(
            RelativeState, "/deputy/relative_state", self.states.append, qos.subscribe(True)
        )

    def has_states(self, count: int) -> bool:
        """Return whether so many relative states have come."""
        return len(self.states) == count

    def count(self, name: str) -> int:
        """Return a number of the diagnostics."""
        (status,) = self.node.health()
        return int({pair.key: pair.value for pair in status.values}[name])


@pytest.fixture
def bench(ros_context: rclpy.Context) -> Iterator[Bench]:
    made = Bench(ros_context, estimator="paper", patience=0.01)
    yield made
    made.close()


def test_thrust_that_is_not_finite_is_refused(bench: Bench):
    """The refused thrust is counted, and the node goes on."""
    for second, value in enumerate((math.nan, math.inf, 0.1)):
        message = AccelStamped()
        message.header.stamp = to_stamp(EPOCH + second * SECOND)
        message.accel.linear.y = value
        bench.thrust.publish(message)
    bench.spin_until(lambda: bench.count("thrust not finite") == 2)
    bench.clock.publish(Clock(clock=to_stamp(EPOCH + 3 * SECOND)))
    bench.spin_until(lambda: bool(bench.states))
    assert bench.states[0].solution == RelativeState.SOLUTION_NONE


def message_of(epoch: ObservationEpoch, time: GpsTime) -> GnssObservations:
    """Return the message of an epoch whose true time is given."""
    tag = epoch.time
    message = GnssObservations(gps_week=tag.week, gps_time_of_week=tag.time_of_week)
    message.header.stamp = to_stamp(time.to_unix_nanoseconds())
    for name in OBSERVATION_COLUMNS:
        setattr(message, name, getattr(epoch, name))
    return message


def content(message: object) -> list[bytes]:
    """Return the bytes of each field of a message, numbers that are NaN among them."""
    names = message.get_fields_and_field_types()
    fields = {name: getattr(message, name) for name in names if name != "header"}
    return [np.asarray(value).tobytes() for value in fields.values()]


def solutions_of(bench: Bench, scenario: Scenario, *, seconds: int) -> list[list[bytes]]:
    """Fly a scenario through a node; return the content of all that it publishes, topic by topic.

    In lockstep thrust comes first. In real time the deputy is heard first, and its thrust between
    the two epochs.
    """
    published: dict[str, list[list[bytes]]] = {}
    kinds = {"relative_state": RelativeState, "ambiguities": AmbiguityStatus}
    for name, kind in {**kinds, "differential_tec": SlantTec}.items():
        contents = published[name] = []

        def keep(message: object, contents: list[list[bytes]] = contents) -> None:
            contents.append(content(message))

        bench.probe.create_subscription(kind, f"/deputy/{name}", keep, qos.subscribe(True))
    node = bench.node
    for ephemeris in scenario.ephemerides:
        node._on_ephemeris(ephemeris_to_message(ephemeris))
    for second in range(seconds):
        time = START + float(second)
        chief, deputy = (
            message_of(epochs[time], time) for epochs in (scenario.chief, scenario.deputy)
        )
        thrust = AccelStamped()
        thrust.header.stamp = to_stamp((time - 1.0).to_unix_nanoseconds())
        thrust.accel.linear.y = 1e-3 * (second % 3)
        if node.lockstep:
            node._on_thrust("deputy", thrust)
            node._on_epoch("chief", chief)
            node._on_epoch("deputy", deputy)
        else:
            node._on_epoch("deputy", deputy)
            node._on_thrust("deputy", thrust)
            node._on_epoch("chief", chief)
    bench.spin_until(lambda: all(len(each) == seconds for each in published.values()))
    return list(published.values())


def test_real_time_and_lockstep_give_the_same_numbers(ros_context):
    """The same epochs and thrust make the same bytes on all topics, from the first one on."""
    seconds = 40  # the filter learns noise and accelerations at each of them
    scenario = simulate(seconds)
    flown = []
    for lockstep in (False, True):
        bench = Bench(ros_context, signals=["G1", "G2"], lockstep=lockstep)
        try:
            flown.append(solutions_of(bench, scenario, seconds=seconds))
            assert bench.count("epochs fixed") > seconds // 2
        finally:
            bench.close()
    assert flown[0] == flown[1]


def test_a_new_beginning_answers_the_first_epoch(bench: Bench):
    """Epochs of a log that begins again are answered as those of the first reading."""
    stamps = [to_stamp(EPOCH), to_stamp(EPOCH - 100 * SECOND)]
    for count, stamp in enumerate(stamps, start=1):
        bench.node._on_clock(Clock(clock=stamp))
        bench.spin_until(functools.partial(bench.has_states, count))
    assert [state.header.stamp for state in bench.states] == stamps


def test_an_estimator_that_fails_between_epochs_ends_the_node_in_order(bench: Bench):
    """The last epoch is answered once more, without a solution."""

    def fail() -> None:
        raise ValueError("no more")

    bench.node._on_clock(Clock(clock=to_stamp(EPOCH)))
    bench.spin_until(lambda: bench.has_states(1))
    bench.node._tell(fail)
    bench.spin_until(lambda: bench.has_states(2))
    assert bench.node.exit_code == 1 and "no more" in bench.node.problem
    assert bench.states[-1].solution == RelativeState.SOLUTION_NONE


def test_integrator_reaches_the_filter():
    given = RelativeEkfParameters(integrator="euler", longest_step=0.5)
    configuration = make_cdgps(estimator_setting(given)).configuration
    assert (configuration.integrator, configuration.longest_step) == ("euler", 0.5)


def test_wrong_integrator_is_refused(ros_context):
    with pytest.raises(ParameterError, match="integrator"):
        RelativeEkfNode(
            context=ros_context, parameter_overrides=[Parameter("integrator", value="rk5")]
        )


def written_antex(folder: pathlib.Path) -> str:
    """Return the path of an ANTEX file with the antenna PATCH NONE, which has L1 alone."""
    lines = (
        ("", "START OF ANTENNA"),
        ("PATCH           NONE", "TYPE / SERIAL NO"),
        ("     0.0", "DAZI"),
        ("     0.0  90.0  90.0", "ZEN1 / ZEN2 / DZEN"),
        ("   G01", "START OF FREQUENCY"),
        ("      0.00      0.00     50.00", "NORTH / EAST / UP"),
        ("   NOAZI    0.00    4.00", ""),
        ("   G01", "END OF FREQUENCY"),
        ("", "END OF ANTENNA"),
    )
    path = folder / "antennas.atx"
    path.write_text("".join(f"{text:<60}{label}\n" for text, label in lines), encoding="ascii")
    return str(path)


def test_antennas_reach_the_filter(tmp_path):
    given = RelativeEkfParameters(
        signals=["G1"],
        antex_file=written_antex(tmp_path),
        deputy_antenna="PATCH NONE",
        lever_arm_frame="body",
        deputy_lever_arm=[0.1, 0.2, -0.3],
        deputy_lever_arm_sigma=0.02,
        deputy_quaternion=[0.0, 0.0, 1.0, 0.0],
        chief_attitude_frame="rtn",
    )
    antennas = make_cdgps(estimator_setting(given)).configuration.antennas
    assert antennas is not None and antennas.chief.phase_centre is None
    assert antennas.chief.attitude_frame == "rtn"
    deputy = antennas.deputy
    assert deputy.phase_centre is not None
    assert deputy.phase_centre.maps["G01"].offset.tolist() == [0.0, 0.0, 0.05]
    assert deputy.lever_arm_body == (0.1, 0.2, -0.3) and deputy.lever_arm_sigma == 0.02
    assert deputy.quaternion == (0.0, 0.0, 1.0, 0.0)


def test_antennas_are_ideal_only_if_that_is_stated():
    """The filter takes millimetres for antennas without a word; zeros stand for ideal antennas."""
    silent = make_cdgps(estimator_setting(RelativeEkfParameters())).configuration.antennas
    assert silent is not None and silent.are_central
    assert all(0.001 <= antenna.offset_sigma <= 0.003 for antenna in silent.both)
    stated = RelativeEkfParameters(chief_phase_map_sigma=0.0, deputy_phase_map_sigma=0.0)
    assert make_cdgps(estimator_setting(stated)).configuration.antennas is None
    half = RelativeEkfParameters(chief_phase_map_sigma=0.0)
    antennas = make_cdgps(estimator_setting(half)).configuration.antennas
    assert antennas is not None
    assert [label[1] for label in antennas.offset_variances()] == [1, 1, 1]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"deputy_lever_arm": [0.1, 0.0, 0.0]}, "lever_arm_frame: deputy_lever_arm needs the name"),
        ({"chief_antenna": "PATCH NONE"}, "antex_file: the file that has chief_antenna"),
        (
            {"antex_file": "{antex}", "chief_antenna": "CHOKE NONE"},
            "chief_antenna: .*antennas.atx: there is no antenna 'CHOKE NONE'",
        ),
        (
            {"antex_file": "absent.atx", "chief_antenna": "A NONE"},
            "antex_file: absent.atx: No such",
        ),
        ({"antex_file": "{antex}"}, "antex_file: chief_antenna or deputy_antenna is needed"),
        (
            {"lever_arm_frame": "body", "chief_lever_arm": [0.1]},
            "chief_lever_arm: three numbers",
        ),
        ({"deputy_quaternion": [0.0, 0.0, 0.0, 0.0]}, "deputy_quaternion: four numbers"),
    ],
)
def test_wrong_antennas_are_refused(tmp_path, values, text):
    antex = written_antex(tmp_path)
    values = {name: antex if value == "{antex}" else value for name, value in values.items()}
    with pytest.raises(ValueError, match=text):
        antenna_pair(RelativeEkfParameters(**values))


def test_antenna_without_a_carrier_is_refused_in_one_line(tmp_path, ros_context):
    values = {"antex_file": written_antex(tmp_path), "chief_antenna": "PATCH NONE"}
    with pytest.raises(ParameterError, match="'PATCH NONE' has no frequency G02") as refusal:
        RelativeEkfNode(
            context=ros_context,
            parameter_overrides=[Parameter(name, value=v) for name, v in values.items()],
        )
    assert "\n" not in str(refusal.value)
