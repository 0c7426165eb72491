"""The node relative_ekf where its inputs are wrong."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Iterator

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from node_bench import NodeBench  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from vtff_dynamics.time.timescales import GpsTime  # noqa: E402
from vtff_msgs.msg import RelativeState  # noqa: E402
from vtff_nav import relative_ekf_node  # noqa: E402
from vtff_nav.relative.common.solution import (  # noqa: E402
    _SHAPES,
    SOLUTION_PREDICTED,
    RelativeSolution,
)
from vtff_nav.relative.shipped_estimators import make_cdgps  # noqa: E402
from vtff_nav.relative_ekf_node import (  # noqa: E402
    RelativeEkfNode,
    RelativeEkfParameters,
    antenna_pair,
    estimator_setting,
)
from vtff_node import qos  # noqa: E402
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


class LoggedEstimator:
    """Predicts a fixed state, and notes what it is asked for."""

    learns_later = False

    def __init__(self, log: list[str], *, fails: bool = False) -> None:
        self._log = log
        self._fails = fails

    def process(self, time: GpsTime, *_measured: object) -> RelativeSolution:
        self._log.append("process")
        zeros = {name: np.zeros(shape) for name, shape in _SHAPES.items()}
        return RelativeSolution(time=time, solution=SOLUTION_PREDICTED, **zeros)

    def learn(self) -> None:
        self._log.append("learn")
        if self._fails:
            raise ValueError("learning failed")

    def reset(self) -> None:
        self._log.append("reset")


def logged_bench(
    context: rclpy.Context, *, fails: bool = False, **parameters: object
) -> tuple[Bench, list[str]]:
    """Return a node with that estimator, and the list of what is done in it."""
    bench = Bench(context, patience=0.01, **parameters)
    log: list[str] = []
    node = bench.node
    node._estimator = LoggedEstimator(log, fails=fails)
    for name in ("state", "ambiguity", "tec"):
        publisher = getattr(node, f"_{name}_publisher")

        def publish(message, name=name, publish=publisher.publish):
            log.append(name)
            publish(message)

        publisher.publish = publish
    return bench, log


def test_in_real_time_only_the_state_comes_before_the_command(ros_context):
    """Nothing is lost: an epoch, or the end of the node, finishes the epoch before."""
    bench, log = logged_bench(ros_context)
    later = ["ambiguity", "tec", "learn"]
    try:
        for second in range(2):
            bench.clock.publish(Clock(clock=to_stamp(EPOCH + second * SECOND)))
            bench.spin_until(lambda: log[-1:] == ["learn"])
            assert log == ["process", "state", *later]
            log.clear()
        bench.node._unfinished_until = math.inf
        for second in (2, 3):  # at once, as after a pause of the process
            bench.node._on_clock(Clock(clock=to_stamp(EPOCH + second * SECOND)))
        bench.spin_until(lambda: log.count("state") == 2)
        assert log[:5] == ["process", "state", *later]
        bench.node.on_stop()
        assert log[5:] == ["process", "state", *later]
    finally:
        bench.close()


def test_an_error_or_a_new_beginning_loses_no_table(ros_context, monkeypatch):
    monkeypatch.setattr(relative_ekf_node, "COMMAND_TIME", math.inf)
    bench, log = logged_bench(ros_context)
    tables = ["ambiguity", "tec"]

    def fail() -> None:
        raise ValueError("no more")

    try:
        bench.node._on_clock(Clock(clock=to_stamp(EPOCH)))
        bench.spin_until(lambda: log == ["process", "state"])
        bench.node._on_clock(Clock(clock=to_stamp(EPOCH - 100 * SECOND)))
        bench.spin_until(lambda: log.count("state") == 2)
        assert log == ["process", "state", *tables, "learn", "reset", "process", "state"]
        log.clear()
        bench.node._tell(fail)
        assert log == [*tables, "state", *tables]
        assert bench.node.finished and "no more" in bench.node.problem
    finally:
        bench.close()


def test_in_lockstep_all_of_an_epoch_comes_at_once(ros_context):
    bench, log = logged_bench(ros_context, lockstep=True)
    try:
        bench.node._on_clock(Clock(clock=to_stamp(EPOCH)))
        bench.spin_until(lambda: log[-1:] == ["tec"])
        assert log == ["process", "state", "ambiguity", "tec"]
    finally:
        bench.close()


def test_an_estimator_that_fails_to_learn_ends_the_node_in_order(ros_context):
    bench, log = logged_bench(ros_context, fails=True)
    try:
        bench.node._on_clock(Clock(clock=to_stamp(EPOCH)))
        bench.spin_until(lambda: bench.node.finished)
        assert bench.node.exit_code == 1 and "learning failed" in bench.node.problem
        bench.spin_until(lambda: len(bench.states) == 2)
        assert bench.states[-1].solution == RelativeState.SOLUTION_NONE
    finally:
        bench.close()


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
