"""Training loops: models as torch modules, stochastic gradients, checkpoints."""
