"""Python interface ``import trackbench as tb``, on which ``trackbench run`` rests too.

Scenarios (files, names, texts or mappings) come in; results, and folders with their files, go out. ``trackbench``
itself exports the names, and imports this package when one is first used. Read ``run.py`` first.
"""
