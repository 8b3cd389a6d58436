"""Where the method fails: one module a bad place, each with a figure for docs/where-it-fails.md and its numbers."""
