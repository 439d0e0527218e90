"""Claims that trackbench makes of its statistics, each measured by simulation with fixed seeds.

Every module in this folder with a ``def claims() -> Iterator[Claim]`` is a subject; its docstring is the heading.
"""
