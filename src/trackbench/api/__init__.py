"""What ``import trackbench as tb`` offers, and the work of ``trackbench run``, from a scenario to its result and files.

The names themselves are in ``trackbench``, which imports this package when one of them is first used.
"""
