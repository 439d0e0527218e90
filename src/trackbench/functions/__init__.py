"""Driver assistance functions, run on tracks and on the truth alike: what they decide is what a tracker is needed for.

Those that a scenario can name are published under the entry points of ``FUNCTIONS``.
"""

from trackbench.functions.protocol import FUNCTIONS, Decision, Ego, EgoScene, Function, Objects, Quantity, decision

__all__ = ["FUNCTIONS", "Decision", "Ego", "EgoScene", "Function", "Objects", "Quantity", "decision"]
