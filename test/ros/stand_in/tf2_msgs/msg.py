"""Stands in for tf2_msgs, which PyPI has not: the bytes are those of TFMessages, the type name is another."""

from visualization_msgs.msg import MarkerArray as TFMessage

__all__ = ["TFMessage"]
