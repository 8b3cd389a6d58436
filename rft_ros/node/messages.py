"""Between ROS messages and the estimator's samples."""

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

from rft_ros.estimator import PoseSample, TwistSample, Wrench, WrenchSample

__all__ = ["fill_wrench", "pose_sample", "twist_sample", "wrench_sample"]


def pose_sample(message: PoseStamped) -> PoseSample:
    """The estimator's sample of a PoseStamped."""
    header, p, q = message.header, message.pose.position, message.pose.orientation
    stamp = header.stamp
    return PoseSample(stamp.sec * 1_000_000_000 + stamp.nanosec, header.frame_id, (p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def twist_sample(message: TwistStamped) -> TwistSample:
    """The estimator's sample of a TwistStamped."""
    header, v, w = message.header, message.twist.linear, message.twist.angular
    stamp = header.stamp
    return TwistSample(stamp.sec * 1_000_000_000 + stamp.nanosec, header.frame_id, (v.x, v.y, v.z), (w.x, w.y, w.z))


def wrench_sample(message: WrenchStamped) -> WrenchSample:
    """The estimator's sample of a WrenchStamped."""
    header, f, t = message.header, message.wrench.force, message.wrench.torque
    stamp = header.stamp
    return WrenchSample(stamp.sec * 1_000_000_000 + stamp.nanosec, header.frame_id, (f.x, f.y, f.z, t.x, t.y, t.z))


def fill_wrench(message: WrenchStamped, stamp: int, wrench: Wrench) -> WrenchStamped:
    """Write a stamp [ns] and a wrench into a message that is kept for reuse."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    f, t = message.wrench.force, message.wrench.torque
    f.x, f.y, f.z, t.x, t.y, t.z = wrench
    return message
