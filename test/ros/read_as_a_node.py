"""FILES NODES [ARGUMENT ...]: what the parameters of real nodes are with each of these parameter files, as JSON."""

import itertools
import json
import sys
from pathlib import Path
from unittest import mock

import rclpy
from rclpy.node import Node

from rft_ros.errors import InputError
from rft_ros.node.node_parameters import NodeParameters
from rft_ros.parameters import read_sections


def values(arguments: list[str], files: list[str], name: str) -> object:
    """The values of the node of this full name, or why it does not start."""
    namespace, _, base = name.rpartition("/")
    context = rclpy.Context()
    with mock.patch.object(sys, "argv", ["rft_node", *arguments]):
        try:
            for file in files:
                read_sections(Path(file))  # as the node's `main` does, before ROS reads them
            rclpy.init(args=arguments, context=context)
            node = Node(base, namespace=namespace, context=context, enable_rosout=False, start_parameter_services=False)
            try:
                return NodeParameters(node, prepare=lambda _: None, apply=lambda _: None).values
            finally:
                node.destroy_node()
        except InputError as error:
            return str(error)
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        finally:
            context.try_shutdown()


more = sys.argv[3:]
others = [text for option, text in itertools.pairwise(more) if option == "--params-file"]
answers = [
    [values(["--ros-args", "--params-file", file, *more], [file, *others], node) for node in json.loads(sys.argv[2])]
    for file in json.loads(sys.argv[1])
]
print(json.dumps(answers))
