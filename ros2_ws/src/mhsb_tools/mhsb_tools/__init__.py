"""Commands that a user starts beside the nodes: plan, simulate, record, report, study and more."""
