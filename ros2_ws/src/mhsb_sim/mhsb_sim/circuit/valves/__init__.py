"""Valves between two nodes of the circuit: one module for each kind, and their registry."""
