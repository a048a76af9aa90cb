"""What tests of several packages share: damaged messages, zones ahead of a moving arm, dynamics."""
