"""Metrics of trackers: values with units, intervals and verdicts, and paired differences between trackers.

The estimates or tracks of each block of runs come in with the ground truth. Metric values and their intervals go out,
by tracker and dotted path. Read ``evaluate.py`` first.
"""

from trackbench.metrics.built_in import BUILT_IN
from trackbench.metrics.built_in.basic import EstimateMetric
from trackbench.metrics.evaluate import Evaluation, MetricSums, evaluate, health, merge_sums, no_metrics
from trackbench.metrics.intervals import Interval, clustered, ratio, root
from trackbench.metrics.protocol import Chunk, Fault, Field, Innovation, Metric, Scope, Target
from trackbench.metrics.scorer import Scorer
from trackbench.metrics.sums import BlockScores

__all__ = [
    "BUILT_IN",
    "BlockScores",
    "Chunk",
    "EstimateMetric",
    "Evaluation",
    "Fault",
    "Field",
    "Innovation",
    "Interval",
    "Metric",
    "MetricSums",
    "Scope",
    "Scorer",
    "Target",
    "clustered",
    "evaluate",
    "health",
    "merge_sums",
    "no_metrics",
    "ratio",
    "root",
]
