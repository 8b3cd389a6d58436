"""usage: rft_node --ros-args [--params-file FILE.yaml] [-p NAME:=VALUE] [-r ~/pose:=/tool_pose] ...

Predict the wrench of dry granular material on a moving tool, at each pose, on ROS 2. docs/node.md lists topics
and services, config/default.yaml the parameters. Exit status 0 after SIGINT or SIGTERM, 2 for arguments or parameters
that cannot be used.
"""

import gc
import os
import signal
import socket
import sys
import threading
import time

from rft_ros.errors import InputError
from rft_ros.node.arguments import parameter_files

_GRACE = 1.0  # s; longer than `FeedForward.end`, which takes up to 0.6 s on a busy machine


def main() -> int:
    """Run the node; returns the exit status."""
    stop = _stop_on_signal()
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(__doc__)
        return 0
    refusal = _refused_arguments() or _run(stop)
    if refusal:
        print(f"rft_node: {refusal}", file=sys.stderr)
    return 2 if refusal else 0


def _stop_on_signal() -> threading.Event:
    """An event that SIGINT or SIGTERM sets. If `main` does not return soon after, the process ends with status 0.

    A thread waits for the signals, because the main thread handles none while it imports, compiles or loads.
    """
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    signal.set_wakeup_fd(sender.detach())
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    stop = threading.Event()

    def await_signal() -> None:
        receiver.recv(1)
        stop.set()
        time.sleep(_GRACE)
        os._exit(0)

    threading.Thread(target=await_signal, daemon=True).start()
    return stop


def _refused_arguments() -> str:
    """A sentence on arguments that ROS would ignore or block on; "" if there are none.

    Without this check the node would run with default parameters.
    """
    from rft_ros.files import MAX_YAML, checked_file

    try:
        from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
        from rclpy.utilities import remove_ros_args
    except ImportError as error:
        return f"the node needs ROS 2 ({error}); source a ROS 2 setup file"
    try:
        for file in parameter_files():
            checked_file(file, "parameter file", limit=MAX_YAML)  # ROS would block on a pipe
        left = remove_ros_args(sys.argv)[1:]
    except InputError as error:
        return str(error)
    except UnknownROSArgsError as error:
        return f"unknown ROS argument {str(error).strip('[]')}"
    except RCLError:
        return ""  # rclpy.init reports errors in ROS's own arguments
    advice = "ROS arguments, such as --params-file, come after --ros-args"
    return f"cannot use '{' '.join(left)}'; {advice}" if left else ""


def _run(stop: threading.Event) -> str:
    """Run the node until `stop` is set. Returns the reason if it cannot run, otherwise ""."""
    from rft_ros.node.tool_worker import ToolWorker

    worker = ToolWorker()  # first: its imports take as long as the node's
    import rclpy
    from rclpy.exceptions import ParameterException
    from rclpy.signals import SignalHandlerOptions

    from rft_ros.node.rft_node import RftNode, executor_of
    from rft_ros.node.topics import start_ros
    from rft_ros.parameters import read_sections

    try:
        for file in parameter_files():
            read_sections(file)  # raises the same error as a replay; that of ROS is longer
        try:
            start_ros(signal_handler_options=SignalHandlerOptions.NO)  # first: it checks arguments before code compiles
            node = RftNode(worker)
        except (ParameterException, RuntimeError) as error:  # of arguments, qos_overrides and use_sim_time
            return str(error).partition(", at ")[0]
        gc.collect()
        gc.freeze()  # collecting the objects of numba takes 22 ms and frees none
        executor = executor_of(node)
        executor.add_node(node)
        node.announce("ready")
        try:
            while not stop.is_set():
                executor.spin_once(timeout_sec=0.1)  # EventsExecutor.spin hangs in the PyPI wheel of rclpy 7.1.5
        finally:
            node.feedforward.end()
        executor.shutdown()
        node.destroy_node()
    except InputError as error:
        return str(error)
    finally:
        rclpy.try_shutdown()
        worker.end()
    return ""


if __name__ == "__main__":
    sys.exit(main())
