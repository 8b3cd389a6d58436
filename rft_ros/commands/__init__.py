"""The `rft` commands: their options, and what runs them, which imports what it needs when it runs."""
