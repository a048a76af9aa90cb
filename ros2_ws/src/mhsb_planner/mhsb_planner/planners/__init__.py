"""Ways of planning: each decides where postures come from and gives paths, best in one file.

How to add one: docs/planners.md.
"""
