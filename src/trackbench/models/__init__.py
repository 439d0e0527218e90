"""Motion models and sensor models: plain functions on component arrays."""
