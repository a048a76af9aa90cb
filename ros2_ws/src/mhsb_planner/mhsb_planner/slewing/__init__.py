"""Arms that slew: paths in their plane, the turning of that plane, and zones in space."""
