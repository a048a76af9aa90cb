"""Arms that slew: paths in the arm's plane, the slew motion along them, and zones in space.

The slew is joint 1; it turns the arm about an upright axis. The other joints move in a vertical
plane that turns with the slew.
"""
