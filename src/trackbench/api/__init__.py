"""Python interface ``import trackbench as tb``; the command ``trackbench run`` uses it too.

Scenarios (files, names, texts or mappings) come in; results, and folders with their files, go out. ``trackbench``
itself exports the names, and imports this package when one is first used. Read ``run.py`` first.
"""
