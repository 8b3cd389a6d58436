"""The evidence: the paper's studies, simulated runs, where the method fails, accuracy against time. Not installed."""
