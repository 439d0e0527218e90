"""Report of a comparison of results: ranking over scenarios, or differences by metric, as a document."""
