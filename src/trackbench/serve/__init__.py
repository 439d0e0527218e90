"""Trackers as live servers: a client sends readings and gets estimates."""
