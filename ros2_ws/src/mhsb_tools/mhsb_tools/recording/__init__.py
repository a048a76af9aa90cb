"""Writing, repairing and reading recordings (rosbag2 folders)."""
