"""Trackers of several objects, sound and with one fault, that the doctor is measured on."""
