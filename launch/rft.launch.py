"""``ros2 launch rft_ros rft.launch.py``: the node with a parameter file, a namespace and remapped inputs."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the node."""
    default = PathJoinSubstitution([FindPackageShare("rft_ros"), "config", "default.yaml"])
    arguments = {
        "params_file": (default, "Parameter file of the node."),
        "namespace": ("", "Namespace of the node."),
        "pose": ("~/pose", "Topic of the tool's pose (geometry_msgs/PoseStamped)."),
        "twist": ("~/twist", "Topic of the tool's twist (geometry_msgs/TwistStamped)."),
        "wrench": ("~/wrench_measured", "Topic of the load cell (geometry_msgs/WrenchStamped)."),
        "use_sim_time": ("false", "Take time from /clock."),
        "rviz": ("false", "Start RViz with the tool, the forces and the surface."),
    }
    node = Node(
        package="rft_ros",
        executable="rft_node",
        name="rft",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("params_file"), {"use_sim_time": LaunchConfiguration("use_sim_time")}],
        remappings=[
            ("~/pose", LaunchConfiguration("pose")),
            ("~/twist", LaunchConfiguration("twist")),
            ("~/wrench_measured", LaunchConfiguration("wrench")),
        ],
        output="screen",
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", PathJoinSubstitution([FindPackageShare("rft_ros"), "rviz", "rft.rviz"])],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in arguments.items()
    ]
    return LaunchDescription([*declared, node, rviz])
