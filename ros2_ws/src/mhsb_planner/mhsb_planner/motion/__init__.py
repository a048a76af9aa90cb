"""S3 and S4: the trajectory along a path, its mode schedule and its energy."""
