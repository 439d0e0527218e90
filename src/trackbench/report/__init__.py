"""Reports of a run and of a comparison, as documents and as text for the terminal.

A :class:`trackbench.results.Result` or a :class:`trackbench.compare.Comparison` comes in; a
:class:`trackbench.document.Document`, terminal text or a JUnit file goes out. Read ``result.py`` first.
"""
