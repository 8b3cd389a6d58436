"""Figures of recorded and replayed wrenches."""
