"""The figures of a run's report. Each function prepares one, and draws nothing."""
