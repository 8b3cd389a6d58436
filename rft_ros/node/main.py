"""``rft_node``: start, warm up, spin until told to stop."""

import gc
import signal
import sys
import threading

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from rft_ros.errors import InputError
from rft_ros.estimator.warm_up import fork_compilation, warm_up_all
from rft_ros.node.rft_node import RftNode
from rft_ros.prepare_tool import start_preparer

__all__ = ["main"]


def main() -> int:
    """Run the node; exit status 0 after SIGINT or SIGTERM, 2 if its parameters cannot be used."""
    preparer, compilation = start_preparer(), fork_compilation()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        node = RftNode(preparer)
    except InputError as error:
        print(f"rft_node: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        preparer.close()
        return 2
    warm_up_all(compilation, memory=node.estimator.model.mobilization_length > 0.0)
    gc.collect()
    gc.freeze()  # a full collection with numba and trimesh loaded costs 22 ms, and there is nothing of theirs to free
    for finding in node.estimator.model.tool.findings:
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


if __name__ == "__main__":
    sys.exit(main())
