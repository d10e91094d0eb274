"""Training-free ego-centric scenes, one file per step of the paper: split, fuse, close, and what follows."""
