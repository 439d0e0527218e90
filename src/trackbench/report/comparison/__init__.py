"""Report of a comparison, as a document."""
