"""The hydraulic circuit: its elements, and the network that they form."""
