"""Figures and web pages of replays and of a tool in the grains."""
