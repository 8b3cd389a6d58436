"""The bare minimum beside which rft_node is measured: the same three subscriptions, one WrenchStamped out per pose."""

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy


class EchoNode(Node):  # type: ignore[misc]
    """Answers a pose with the last wrench it saw."""

    def __init__(self) -> None:
        super().__init__("rft")
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=200, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        out = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=200, reliability=ReliabilityPolicy.RELIABLE
        )
        self._answer = WrenchStamped()
        self._answer.header.frame_id = "ft_sensor"
        self._publisher = self.create_publisher(WrenchStamped, "~/wrench_predicted", out)
        self.create_subscription(WrenchStamped, "~/wrench_measured", self._on_wrench, qos)
        self.create_subscription(TwistStamped, "~/twist", self._on_twist, qos)
        self.create_subscription(PoseStamped, "~/pose", self._on_pose, qos)

    def _on_wrench(self, message: WrenchStamped) -> None:
        self._answer.wrench = message.wrench

    def _on_twist(self, message: TwistStamped) -> None:
        self._twist = message

    def _on_pose(self, message: PoseStamped) -> None:
        self._answer.header.stamp = message.header.stamp
        self._publisher.publish(self._answer)


def main() -> None:
    rclpy.init()
    node = EchoNode()
    name = node.declare_parameter("executor", "single").value
    executor = EventsExecutor() if name == "events" else SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while True:
            executor.spin_once(timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
