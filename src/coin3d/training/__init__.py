"""Training: samples, loop, checkpoints, run directories; and running a trained detector over a recording."""
