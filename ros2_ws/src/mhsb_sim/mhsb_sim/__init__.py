"""Simulator: mechanics, hydraulic circuit, servo; recorder and report."""
