"""Runner: takes the trackers of a scenario through the measurements of all its Monte-Carlo runs.

A checked scenario and the ground truths of its scenes come in; a result with its tables goes out. Runs are made in
blocks, in this process or in others, and the blocks merge exactly. Read ``loop.py`` first.
"""
