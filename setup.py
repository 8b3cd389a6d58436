"""ament_python package of rft_ros; works with colcon on ROS 2 Jazzy and with plain pip."""

from glob import glob

from setuptools import find_packages, setup

NAME = "rft_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="The wrench that dry granular material puts on a robot's tool, in real time, by 3D RFT.",
    license="Apache-2.0",
    maintainer="rft_ros maintainers",
    maintainer_email="maintainers@rft-ros.invalid",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", glob("config/*.yaml") + glob("config/*.xml")),
        (f"share/{NAME}/rviz", glob("rviz/*.rviz")),
        (f"share/{NAME}/launch", glob("launch/*.py")),
        (f"share/{NAME}/meshes", glob("meshes/*.stl")),
        # ros2 run and ros2 launch look here; pip ignores setup.cfg's install_scripts (DESIGN 6).
        (f"lib/{NAME}", ["scripts/rft_node", "scripts/rft"]),
    ],
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "numba>=0.60",
        "scipy>=1.11",
        "trimesh>=4.4",
        "pycollada>=0.8",
        "rosbags>=0.10.9",
        "PyYAML>=6.0",
        "rich>=13.0",
        "matplotlib>=3.8",
        "plotly>=5.20",
        "fast-simplification>=0.1.7",
    ],
    extras_require={
        "ros": ["ros-jazzy-common-interfaces", "ros-rclpy[fastrtps]==7.1.6"],
        "sweep": ["dask[distributed]>=2024.1", "pyarrow>=14"],
        "test": ["pytest>=8", "pytest-xdist>=3.5", "hypothesis>=6.100", "dask[distributed]>=2024.1", "pyarrow>=14"],
        "dev": ["mpmath>=1.3", "mypy>=1.10", "ruff>=0.6", "types-PyYAML", "scipy-stubs; python_version >= '3.11'"],
    },
    entry_points={"console_scripts": ["rft = rft_ros.cli:main", "rft_node = rft_ros.node.main:main"]},
    zip_safe=True,
)
