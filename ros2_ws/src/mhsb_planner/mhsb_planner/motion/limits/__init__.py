"""Limits of a joint motion: one module for each limit, and the registry that lists them."""
