"""Obstacles that the arm must keep clear of, and its distance from them."""
