"""The facade: from samples and a model expression to an estimate."""
