"""Detection metrics and the protocols that say what they mean. ``score`` is the way in."""

from coin3d.evaluation.box_table import BoxTable
from coin3d.evaluation.filters import filter_predictions, filter_truth
from coin3d.evaluation.matching import Matches, match
from coin3d.evaluation.metrics import ClassMetrics, Metrics, evaluate, nds_star, prediction_table
from coin3d.evaluation.protocol import DEFAULT_RANGE_M, Protocol
from coin3d.evaluation.score import Report, annotated_boxes, score, score_tables, truth_table

__all__ = [
    "DEFAULT_RANGE_M",
    "BoxTable",
    "ClassMetrics",
    "Matches",
    "Metrics",
    "Protocol",
    "Report",
    "annotated_boxes",
    "evaluate",
    "filter_predictions",
    "filter_truth",
    "match",
    "nds_star",
    "prediction_table",
    "score",
    "score_tables",
    "truth_table",
]
