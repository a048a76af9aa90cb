"""Planners: each decides where postures come from and proposes paths, preferably in one file.

How to add one: docs/planners.md.
"""
