"""Soak test: hours of goals, stops, kills and faults, and promises that must be kept throughout."""
