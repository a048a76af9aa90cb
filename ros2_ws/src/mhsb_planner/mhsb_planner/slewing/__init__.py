"""Arms that slew: paths in their plane, the slew motion along them, and zones in space."""
