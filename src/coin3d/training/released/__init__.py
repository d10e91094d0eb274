"""Weights released by others, renamed and rearranged for the detectors of this project."""
