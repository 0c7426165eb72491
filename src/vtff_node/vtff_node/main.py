"""The main loop of a node process, and of several nodes composed in one process."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import inspect
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from vtff_node import parameters
from vtff_node.node import ACKNOWLEDGE_TIMEOUT, EXIT_FAILURE, EXIT_USAGE, CommonParameters, VtffNode
from vtff_node.parameters import ParameterError
from vtff_node.plugins.loading import PluginError, help_lines
from vtff_node.process.callback_watch import CallbackWatch
from vtff_node.process.leaving import leave_process, leave_process_after
from vtff_node.process.lifeline import watch_lifeline
from vtff_node.process.priority import (
    is_niceness_chosen,
    run_at_once,
    set_niceness,
    yield_to_others,
)
from vtff_node.process.stop_signals import StopRequest

try:
    from rclpy.experimental import EventsExecutor as NodeExecutor
except ImportError:
    from rclpy.executors import SingleThreadedExecutor as NodeExecutor

#: Longest wait of the executor, s. It is finite, because the EventsExecutor of the wheels never
#: returns from an infinite wait, and short, because it bounds the reaction to a signal.
SPIN_TIMEOUT = 0.1

#: Wait of the executor where messages gather between its looks, s; it takes 0 for no limit.
NO_PATIENCE = 1e-4

#: Time after the end of all nodes at which their process leaves ROS and DDS behind, s.
LEAVE_TIMEOUT = 2.0

#: Time to write the trace of a teardown that is left, s.
TRACE_TIME = 0.5

#: Longest time from the failure of a node to the end of its process, s.
TEARDOWN_TIMEOUT = 10.0

#: New objects after which Python looks for garbage in cycles, of which nodes make little: with the
#: default, 700, the search takes a fortieth of their time.
OBJECTS_BETWEEN_COLLECTIONS = 10_000

#: Errors that making a node raises when a parameter or a ROS argument is wrong.
USAGE_ERRORS = (
    ParameterError,
    ValueError,
    NameValidationException,
    RCLError,
    RCLInvalidROSArgsError,
    UnknownROSArgsError,
)

NodeFactory = Callable[..., VtffNode]


def make_executor() -> Any:
    """Return an EventsExecutor, or a SingleThreadedExecutor where rclpy has none."""
    return NodeExecutor()


def spin(nodes: Sequence[VtffNode], stop: StopRequest) -> int:
    """Run nodes in one executor until one of them finishes or a signal arrives.

    Returns
    -------
    int
        The largest exit code of the nodes.
    """
    # What is there now stays to the end: no collection has to look at it again.
    gc.freeze()
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    executor = make_executor()
    ended: Future = Future()

    def end() -> None:
        if not ended.done():
            ended.set_result(None)

    watch = CallbackWatch(VtffNode, lambda text: nodes[0].get_logger().warning(text))

    def look() -> None:
        watch.come_round()
        # As long as messages come without a pause, the executor does not return by itself.
        if stop.requested:
            end()

    for node in nodes:
        executor.add_node(node)
        node.on_finish = end
        node.begin()
    watch.start()
    if not any(node.lockstep for node in nodes) and not is_niceness_chosen():
        niceness = min(node.niceness for node in nodes)
        if not set_niceness(niceness):
            nodes[0].get_logger().info(f"the system does not permit a niceness of {niceness}")
        elif niceness < 0 and not run_at_once():
            nodes[0].get_logger().info("the system does not permit a real-time priority")
    timer = nodes[0].create_timer(SPIN_TIMEOUT, look, clock=nodes[0].steady_clock)
    if all(node.yields_to_others for node in nodes):
        # Else each message interrupts the node that publishes it.
        yield_to_others()
    try:
        while not stop.requested and not any(node.finished for node in nodes):
            gather_time = min(node.choose_gather_time() for node in nodes)
            # It handles all that has come; `spin_once` would return after each callback.
            executor.spin_until_future_complete(ended, NO_PATIENCE if gather_time else SPIN_TIMEOUT)
            if gather_time:
                time.sleep(gather_time)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        end()
        watch.close()
        timer.cancel()
        deadline = time.monotonic() + ACKNOWLEDGE_TIMEOUT
        for node in nodes:
            node.close(max(0.0, deadline - time.monotonic()))
        limit_teardown()
    exit_code = max((node.exit_code for node in nodes), default=0)
    leave_late_teardown(exit_code)
    executor.shutdown()
    return exit_code


def run_nodes(factories: Sequence[Callable[[], VtffNode]], arguments: Sequence[str]) -> int:
    """Initialise ROS, make the nodes, spin them and clean up; the caller then ends the process.

    Parameters
    ----------
    factories
        Functions that make one node each.
    arguments
        Command line including ``--ros-args`` parts.

    Returns
    -------
    int
        Exit code: 0 done, 1 a node failed, 2 a parameter is wrong.
    """
    stop = StopRequest()
    stop.install()
    watch_lifeline()
    nodes: list[VtffNode] = []
    in_order = False
    try:
        if stop.requested:  # a signal came while Python was still starting
            return 0
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        for factory in factories:
            nodes.append(factory())
    except USAGE_ERRORS as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_USAGE
    except PluginError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_FAILURE
    except MemoryError as error:
        return _end_without_memory(nodes, error)
    else:
        try:
            exit_code = spin(nodes, stop)
        except MemoryError as error:
            return _end_without_memory(nodes, error)
        in_order = True
        return exit_code
    finally:
        if not in_order:
            limit_teardown()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def _end_without_memory(nodes: Sequence[VtffNode], error: MemoryError) -> int:
    names = ", ".join(node.get_fully_qualified_name() for node in nodes) or "node"
    reason = " ".join(str(error).split())
    print(f"error: {names}: no memory is left{': ' if reason else ''}{reason}", file=sys.stderr)
    return EXIT_FAILURE


def leave_late_teardown(exit_code: int) -> None:
    """End the process with the exit code of its nodes if it still exists after `LEAVE_TIMEOUT`.

    The nodes have ended, their last messages are acknowledged, their counts are written: nothing of
    the run is lost. What is left is the work of ROS, DDS and Python, which has been seen to spin
    without end, with the interpreter lock held, and to ignore all signals but SIGKILL. The trace on
    stderr names the call.
    """
    # Without memory there is no thread. Where no timer can be had, `limit_teardown` stays.
    with contextlib.suppress(RuntimeError, OSError, AttributeError):
        leave_process_after(LEAVE_TIMEOUT + TRACE_TIME, exit_code)
        faulthandler.dump_traceback_later(LEAVE_TIMEOUT, file=2)


def limit_teardown() -> None:
    """End the process with code 1 if it still exists after `TEARDOWN_TIMEOUT`.

    Its nodes have not ended in order: making them or spinning them has failed. The trace on stderr
    names the call. faulthandler needs neither the interpreter lock nor a signal handler.
    """
    with contextlib.suppress(RuntimeError):  # without memory its thread cannot be started
        faulthandler.dump_traceback_later(TEARDOWN_TIMEOUT, exit=True, file=2)


def run_node(node_class: NodeFactory) -> None:
    """Run one node and exit with its code: the ``main`` of a node executable."""
    if any(argument in ("-h", "--help") for argument in sys.argv[1:]):
        print(help_text(node_class))
        sys.exit(0)
    leave_process(run_nodes([node_class], sys.argv))


def help_text(node_class: Any) -> str:
    """Return the help of a node executable: the docstring of the node and its parameters."""
    lines = [inspect.cleandoc(node_class.__doc__ or ""), ""]
    lines.append("Parameters (--ros-args -p name:=value):")
    for table in filter(None, (node_class.Parameters, CommonParameters)):
        lines += _table_lines(table)
    if node_class.Plugins is not None:
        lines += help_lines(node_class.Plugins, _table_lines)
    return "\n".join(lines)


def _table_lines(table: type) -> list[str]:
    lines = []
    for field in parameters.fields_in_order(table):
        is_required = parameters.metadata_of(field)["required"]
        default = "required" if is_required else parameters.default_of(field)
        if default is None:
            default = "not given"
        if default == "":
            default = '""'  # an empty text shows
        lines.append(f"  {field.name:28} {parameters.describe(field)}; default: {default}")
    return lines
