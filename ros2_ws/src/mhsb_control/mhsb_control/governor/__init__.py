"""Reference governor: boosts and slows beyond the plan if measurements require it."""
