"""Numbers as the benchmark's page prints them."""


def digits(value: float) -> str:
    """Return a number to three digits."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
