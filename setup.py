"""ament_python package of rft_ros; works with colcon on ROS 2 Jazzy and with plain pip.

Name, version, description, licence and maintainer are read from package.xml, as ROS tools do.
"""

from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

MANIFEST = ElementTree.parse(Path(__file__).resolve().parent / "package.xml")
NAME = MANIFEST.findtext("name", "")

SWEEP = ["dask[distributed]>=2024.1"]
STUDIES = ["matplotlib>=3.6.3"]
MUJOCO = [
    "mujoco>=3.12",
    *STUDIES,  # pictures of the examples
]  # with 3.9 a block by contact on a plate rests 7 % too high under elliptic cones
DOCS = [
    "mkdocs-material>=9.5",
    "latex2mathml>=3.77",
    "mkdocstrings[python]>=0.27",
    "pymdown-extensions<12; python_version < '3.11'",  # later ones stop the last mkdocstrings for Python 3.10
]

setup(
    name=NAME,
    version=MANIFEST.findtext("version"),
    description=MANIFEST.findtext("description"),
    license=MANIFEST.findtext("license"),
    maintainer=MANIFEST.findtext("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", glob("config/*.*")),
        (f"share/{NAME}/config/robots", glob("config/robots/*.yaml")),
        (f"share/{NAME}/rviz", glob("rviz/*.rviz")),
        (f"share/{NAME}/launch", glob("launch/*.py")),
        (f"share/{NAME}/meshes", glob("meshes/*.stl")),
        # ros2 run and ros2 launch look here; pip ignores setup.cfg's install_scripts.
        (f"lib/{NAME}", ["scripts/rft_node", "scripts/rft"]),
    ],
    install_requires=[
        "numpy>=1.26.4",
        "numba>=0.58.1,<0.70",  # `rft.kernel.compilation` names what it uses beyond the documented interface
        "scipy>=1.11.4",
        "trimesh>=4.5",
        "pycollada>=0.7.2",
        "rosbags>=0.11.9,<0.12",
        "mcap>=1.1",
        "PyYAML>=6.0.1",
        "rich>=13.7.1",
        "plotly>=5.15",
        "fast-simplification>=0.1.7",
    ],
    extras_require={
        "ros": ["ros-jazzy-common-interfaces", "ros-rclpy[fastrtps]==7.1.6"],
        "sweep": SWEEP,
        "mujoco": MUJOCO,
        "docs": DOCS,
        "studies": STUDIES,
        "test": [
            "pytest>=7.4.4",
            "pytest-xdist>=3.4",
            "hypothesis>=6.98.15",
            "build>=1.0",
            "colcon-common-extensions",
            "catkin_pkg>=1.0",
            *SWEEP,
            *MUJOCO,
            *DOCS,
            *STUDIES,
        ],
        "dev": [
            "mpmath>=1.3",
            "mypy>=1.10",
            "ruff>=0.6",
            "types-PyYAML",
            "scipy-stubs; python_version >= '3.11'",
        ],
    },
    entry_points={
        "console_scripts": [f"rft = {NAME}.cli:main", f"rft_node = {NAME}.node.main:main"]
    },
    zip_safe=True,
)
