"""Readers of the file formats of recorded traffic, one module for a format or a family of formats."""
