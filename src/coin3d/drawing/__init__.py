"""Pictures of what the numbers say. Images are (h, w, 3) uint8 RGB; every function returns a new one."""
