"""Parameters of which every texel of an object has its own values."""
