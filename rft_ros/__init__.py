"""rft_ros: the wrench that dry granular material puts on a robot's tool, in real time.

Force ON the tool BY the grains; SI units; z up; quaternions xyzw.
"""
