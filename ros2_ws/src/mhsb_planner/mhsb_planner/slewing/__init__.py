"""Arms that slew: paths in the arm's plane, the slew motion along them, and zones in space.

The slew is a first joint that turns the arm about an upright axis. The other joints move in a
vertical plane that turns with it.
"""
