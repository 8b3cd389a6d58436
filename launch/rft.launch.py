"""``ros2 launch rft_ros rft.launch.py``: the node with a parameter file, a namespace and remapped inputs."""

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

_BOOLEANS = ["true", "false", "True", "False"]
_INPUTS = {
    "pose": ("pose", "the tool's pose (geometry_msgs/PoseStamped)"),
    "twist": ("twist", "the tool's twist (geometry_msgs/TwistStamped)"),
    "wrench": ("wrench_measured", "the load cell (geometry_msgs/WrenchStamped)"),
    "surface_points": (
        "surface_points",
        "the ground's heights (sensor_msgs/PointCloud2), with ground.cell over 0",
    ),
}


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the node."""
    default = PathJoinSubstitution([FindPackageShare("rft_ros"), "config", "default.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=default, description="Parameter file of the node."
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="Namespace of the node."
            ),
            *(
                DeclareLaunchArgument(
                    name, default_value=f"~/{topic}", description=f"Topic of {what}."
                )
                for name, (topic, what) in _INPUTS.items()
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="",
                choices=["", *_BOOLEANS],
                description="Take time from /clock; empty: as params_file says.",
            ),
            DeclareLaunchArgument(
                "rviz",
                default_value="false",
                choices=_BOOLEANS,
                description="Start RViz with the tool, the forces and the surface.",
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


def _fault(file: Path) -> str:
    """What is wrong with a path that is not a file."""
    if file.is_dir():
        return "is a folder"
    return "is a pipe or a device" if file.exists() else "does not exist"


def _nodes(context: LaunchContext) -> list[Node]:
    """The nodes to start. Launch ends with the sentence of an error that is raised before any of them runs."""
    given = LaunchConfiguration("params_file").perform(context)
    file = Path(given).expanduser()
    if not file.is_file():
        raise RuntimeError(f"params_file '{given}' {_fault(file)}; give a parameter file (YAML)")
    time = LaunchConfiguration("use_sim_time").perform(context)
    nodes = [
        Node(
            package="rft_ros",
            executable="rft_node",
            name="rft",
            namespace=LaunchConfiguration("namespace"),
            parameters=[str(file), *([{"use_sim_time": time.lower() == "true"}] if time else [])],
            remappings=[
                (f"~/{topic}", LaunchConfiguration(name)) for name, (topic, _) in _INPUTS.items()
            ],
            output="screen",
        )
    ]
    if LaunchConfiguration("rviz").perform(context).lower() == "true":
        try:
            get_package_prefix("rviz2")
        except PackageNotFoundError:
            raise RuntimeError(
                "rviz:=true needs the package rviz2: sudo apt install ros-jazzy-rviz2"
            ) from None
        view = PathJoinSubstitution([FindPackageShare("rft_ros"), "rviz", "rft.rviz"])
        nodes.append(Node(package="rviz2", executable="rviz2", arguments=["-d", view]))
    return nodes
