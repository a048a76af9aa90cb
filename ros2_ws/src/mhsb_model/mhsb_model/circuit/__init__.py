"""Hydraulic circuit of a machine: component equations, constants and record types."""
