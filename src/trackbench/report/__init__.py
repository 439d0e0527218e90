"""What a reader sees of a result: an HTML report, Markdown, a terminal table, and a comparison over scenarios.

Everything here is made from a :class:`trackbench.results.RunResult` alone; nothing is run again.
"""
