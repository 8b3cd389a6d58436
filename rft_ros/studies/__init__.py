"""The paper's experiments, computed again: motions, work, one module for each study."""
