"""One module for each `rft` command: its options, and `run`, which imports what it needs when it runs."""
