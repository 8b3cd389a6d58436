"""Hypotheses about what is wrong with a cell's set-up, judged on arrays of what was sent, measured and predicted."""

from rft_ros.diagnosis.evidence import Evidence, Finding, evidence_of
from rft_ros.diagnosis.table import HYPOTHESES, SILENT, Hypothesis, diagnose

__all__ = ["HYPOTHESES", "SILENT", "Evidence", "Finding", "Hypothesis", "diagnose", "evidence_of"]
