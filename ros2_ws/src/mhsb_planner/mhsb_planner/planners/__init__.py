"""Planners: each proposes paths for a request, with postures from its own source.

How to add one: docs/planners.md.
"""
