"""Plausible sizes of a tool [m], by its largest extent. Beyond them its mesh is in another unit."""

__all__ = ["LARGEST", "LARGEST_USUAL", "SMALLEST", "SMALLEST_USUAL"]

SMALLEST = 1e-3
"""A smaller tool is not larger than some grains."""

SMALLEST_USUAL = 5e-3
"""The check of a mesh reports a smaller tool as an issue: in metres, its file would hold a tool of a usual size."""

LARGEST_USUAL = 5.0
"""The check of a mesh reports a larger tool as an issue, and proposes a scale."""

LARGEST = 10.0
"""A larger tool cannot move through grains on an arm; a bulldozer's blade has 7 m."""
