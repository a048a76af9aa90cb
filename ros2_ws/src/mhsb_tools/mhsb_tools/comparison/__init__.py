"""Comparison of planners, and of ways to supply the arm with oil."""
