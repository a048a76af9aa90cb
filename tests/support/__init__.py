"""Helpers of several packages' tests: damaged messages, zones ahead of an arm, motions, scripts."""
