"""S2: search for the discrete path over tip positions and mode patterns."""
