"""The Zenoh router as a Python process: the one address that every other process connects to."""
