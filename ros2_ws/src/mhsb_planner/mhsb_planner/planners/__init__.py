"""Planners, which propose paths for a request, each with postures from its own source.

How to add one: docs/planners.md.
"""
