"""Recordings: one file per format, all giving the same ``Frame``. ``open_recording`` guesses the format."""
