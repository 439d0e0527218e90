"""Truth and sensor models to readings."""
