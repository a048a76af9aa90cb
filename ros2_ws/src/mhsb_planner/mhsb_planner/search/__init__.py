"""S2: the path over positions and modes."""
