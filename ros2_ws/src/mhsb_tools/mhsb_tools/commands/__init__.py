"""Commands that join planner and simulator."""
