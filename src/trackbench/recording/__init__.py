"""A run as a Rerun recording: the scene of one Monte-Carlo run, and the scores over all of them."""

from trackbench.recording.writer import write

__all__ = ["write"]
