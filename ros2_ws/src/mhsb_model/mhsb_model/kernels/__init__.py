"""Compiled functions: the decorator, where they are kept, and how all are compiled at once."""
