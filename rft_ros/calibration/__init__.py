"""From recordings to calibrated parameters of the grains and the load cell, with standard errors."""
