"""Lights from photographs of mirror spheres: where they stand, and how well that is determined."""
