"""``rft_node``: start, warm up, spin until told to stop."""

import gc
import itertools
import signal
import sys
import threading
from pathlib import Path

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rft_ros.errors import InputError
from rft_ros.estimator.parameters import parameter_tree
from rft_ros.estimator.warm_up import await_compilation, fork_compilation, warm_up_all
from rft_ros.node.rft_node import RftNode
from rft_ros.prepare_tool import start_preparer

__all__ = ["main"]

_HELP = """\
usage: rft_node [--ros-args [--params-file FILE.yaml] [-p NAME:=VALUE] [-r ~/pose:=/tool_pose] ...]

Predict the wrench of dry granular material on a moving tool, at each pose, on ROS 2.

Its topics, services and parameters are in the README; config/default.yaml has every parameter with its default.
SIGINT or SIGTERM ends it with exit status 0; arguments or parameters that cannot be used, with 2.

example:
  rft_node --ros-args --params-file my_cell.yaml -r ~/pose:=/tool_pose"""


def main() -> int:
    """Run the node; exit status 0 after SIGINT or SIGTERM, 2 if its arguments or parameters cannot be used."""
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(_HELP)
        return 0
    if refusal := _not_for_ros():
        print(f"rft_node: {refusal}", file=sys.stderr)
        return 2
    preparer, compiling = start_preparer(), fork_compilation()
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RCLError as error:
        print(f"rft_node: {_why(error)}", file=sys.stderr)
        preparer.close()
        return 2
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    await_compilation(compiling)
    try:
        node = RftNode(preparer)
    except InputError as error:
        print(f"rft_node: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        preparer.close()
        return 2
    warm_up_all(memory=node.estimator.model.mobilization_length > 0.0)
    gc.collect()
    gc.freeze()  # a full collection with numba and trimesh loaded costs 22 ms, and there is nothing of theirs to free
    for finding in node.estimator.model.tool.issues:
        node.get_logger().warning(f"mesh {node.estimator.model.tool.name}: {finding.message}")
    node.get_logger().info(f"ready: {node.describe()}")
    executor: Executor = EventsExecutor() if node.executor_name == "events" else SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.1)
    except ExternalShutdownException:
        pass
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        preparer.close()
    return 0


def _not_for_ros() -> str:
    """What to say of arguments that are not ROS's; it passes over most of them, and the node would run on defaults."""
    try:
        left = remove_ros_args(sys.argv)[1:]
    except UnknownROSArgsError as error:
        return f"ROS knows no argument {str(error).strip('[]')}"
    except RCLError:
        return ""  # they are ROS's, and rclpy.init says what is wrong with them
    if not left:
        return ""
    return f"cannot use '{' '.join(left)}'; ROS arguments, such as --params-file, come after --ros-args"


def _why(error: Exception) -> str:
    """What ROS could not use: in the words of a replay where it is a parameter file, else in its own."""
    for option, value in itertools.pairwise(sys.argv):
        if option == "--params-file":
            try:
                parameter_tree(Path(value))
            except InputError as why:
                return str(why)
    return str(error).partition(", at ")[0]


if __name__ == "__main__":
    sys.exit(main())
