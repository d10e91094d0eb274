"""Detection metrics and the protocols that say what they mean. ``score`` is the way in."""

from coin3d.evaluation.filters import filter_predictions, filter_truth
from coin3d.evaluation.metrics import ClassMetrics, Metrics, evaluate, nds_star
from coin3d.evaluation.protocol import DEFAULT_RANGE_M, Protocol
from coin3d.evaluation.score import Report, score

__all__ = [
    "DEFAULT_RANGE_M",
    "ClassMetrics",
    "Metrics",
    "Protocol",
    "Report",
    "evaluate",
    "filter_predictions",
    "filter_truth",
    "nds_star",
    "score",
]
