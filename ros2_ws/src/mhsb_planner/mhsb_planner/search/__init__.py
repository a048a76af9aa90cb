"""Graph search S2: it finds the discrete path over workspace nodes and mode combinations."""
