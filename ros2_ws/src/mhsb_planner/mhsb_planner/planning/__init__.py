"""The planning loop: from a request to a plan."""
