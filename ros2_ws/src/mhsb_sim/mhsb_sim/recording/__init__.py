"""Recordings: writing, mending and reading rosbag2 folders."""
