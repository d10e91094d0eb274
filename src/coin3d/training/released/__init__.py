"""Weights of released implementations, name by name."""
