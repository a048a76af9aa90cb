"""Checks of a motion against the machine: limits of its curve, and loads that cause cavitation."""
