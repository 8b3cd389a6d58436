"""The `rft` commands: for each, what adds its options, and what runs it, whose docstring is its examples."""
