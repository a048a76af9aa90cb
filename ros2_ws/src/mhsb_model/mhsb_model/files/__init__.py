"""Configuration files: locating, reading and checking them, and folders for results."""
