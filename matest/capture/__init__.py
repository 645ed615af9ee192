"""Captures: files on disk, read into photographs of a scene."""

from matest.capture.capture import Capture, load_capture

__all__ = ["Capture", "load_capture"]
