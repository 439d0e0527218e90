"""What a reader sees of a result: an HTML report, Markdown, a terminal table, and a comparison over scenarios.

Everything here is made from a :class:`trackbench.results.Result` alone; nothing is run again.
"""
