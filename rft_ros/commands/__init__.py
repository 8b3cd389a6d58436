"""The `rft` commands: for each, what adds its options, and what runs it, which imports what it needs when it runs."""
