"""Stands in for tf2_msgs, which PyPI has not: the bytes are those of TFMessages, the type name is another.

Where tf2_msgs is installed the same tests use it: .github/workflows/jazzy.yml sees to that.
"""

from visualization_msgs.msg import MarkerArray as TFMessage

__all__ = ["TFMessage"]
