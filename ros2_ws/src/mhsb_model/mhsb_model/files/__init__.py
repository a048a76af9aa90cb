"""Files of settings: where the suite's own are, and how YAML is read."""
