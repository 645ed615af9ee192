"""Formats of other programs that captures are read from, one file a format."""
