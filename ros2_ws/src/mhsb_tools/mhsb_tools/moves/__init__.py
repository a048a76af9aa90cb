"""Moves and their pictures: operating regions, energy flow, the best operating point."""
