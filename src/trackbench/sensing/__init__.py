"""Truth and sensor models to measurements."""
