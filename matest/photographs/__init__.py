"""Photographs: image files, what their pixels encode, the noise of their camera, and the samples that they give."""
