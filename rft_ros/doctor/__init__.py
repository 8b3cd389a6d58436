"""The doctor: finds what is wrong with a cell's set-up, from a bag or beside a running node."""
