"""Inference: from a solution and its samples to values, error bars, intervals and statuses."""
