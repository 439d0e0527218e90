"""Trackers as live servers: a client sends measurements and gets estimates."""
