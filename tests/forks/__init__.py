"""Nodes as processes that are forked from one in which everything is imported and loaded."""
