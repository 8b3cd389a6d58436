"""The `rft` commands. Each has a function that adds its options, and one that runs it. The docstring is its example."""
