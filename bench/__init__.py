"""What is measured by hand: speed and size, by `make bench` and its kin."""
