"""usage: rft_node --ros-args [--params-file FILE.yaml] [-p NAME:=VALUE] [-r ~/pose:=/tool_pose] ...

Predict the wrench of dry granular material on a moving tool, at each pose, on ROS 2. docs/topics.md lists topics
and services, config/default.yaml the parameters. Exit status 0 after SIGINT or SIGTERM, 2 for arguments or parameters
that cannot be used.
"""

import gc
import os
import signal
import sys
import threading
import time
from contextlib import ExitStack

from rft_ros.errors import InputError
from rft_ros.progress import line_if_long

_GRACE = 1.0  # s; longer than `FeedForward.end`, which takes up to 0.6 s on a busy machine


def main() -> int:
    """Run the node; returns the exit status."""
    stop = _stop_on_signal()
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(__doc__)
        return 0
    try:
        _run(stop)
    except InputError as error:
        print(f"rft_node: {error}", file=sys.stderr)
        return 2
    return 0


def _stop_on_signal() -> threading.Event:
    """An event that SIGINT or SIGTERM sets. If `main` does not return soon after, the process ends with status 0.

    A thread waits for the signals, because the main thread handles none while it imports, compiles or loads.
    """
    signals = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    stop = threading.Event()

    def await_signal() -> None:
        signal.sigwait(signals)
        stop.set()
        time.sleep(_GRACE)
        os._exit(0)

    threading.Thread(target=await_signal, daemon=True).start()
    return stop


def _run(stop: threading.Event) -> None:
    """Run the node until `stop` is set. Raises InputError if it cannot run."""
    from rft_ros.node.tool_worker import ToolWorker

    with ExitStack() as running, ExitStack() as starting:
        starting.enter_context(line_if_long("rft_node: loading ROS, the tool and compiled code"))
        worker = ToolWorker()  # first: its imports take as long as the node's
        running.callback(worker.end)
        try:
            import rclpy
            from rclpy.exceptions import ParameterException
            from rclpy.signals import SignalHandlerOptions
        except ImportError as error:
            raise InputError(
                f"the node needs ROS 2 ({error}); source a ROS 2 setup file"
            ) from None
        from rft_ros.node.node_parameters import given_sections
        from rft_ros.node.rft_node import RftNode, executor_of
        from rft_ros.node.topics import start_ros

        arguments = sys.argv[1:]
        # raises the errors of a replay; ROS would say more, and block on a pipe
        list(given_sections(arguments))
        running.callback(rclpy.try_shutdown)
        try:
            # first: it checks arguments before code compiles
            start_ros(signal_handler_options=SignalHandlerOptions.NO)
            node = RftNode(worker, arguments)
        except (ParameterException, RuntimeError) as error:
            # of arguments, qos_overrides and use_sim_time
            raise InputError(str(error).partition(", at ")[0]) from None
        starting.close()
        gc.collect()
        gc.freeze()  # collecting the objects of numba takes 22 ms and frees none
        executor = executor_of(node)
        executor.add_node(node)
        node.announce("ready")
        try:
            while not stop.is_set():
                # EventsExecutor.spin hangs in the PyPI wheel of rclpy 7.1.5
                executor.spin_once(timeout_sec=0.1)
        finally:
            node.destroy_node()  # first brings the feed-forward to zero
            executor.shutdown()


if __name__ == "__main__":
    sys.exit(main())
