"""Reproduction of the paper: its cases and sweeps are run and judged, and its figures drawn."""
