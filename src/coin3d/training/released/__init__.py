"""Weights released by others, under our names: one file per network, every key mapped or left out for a stated reason."""
