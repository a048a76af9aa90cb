"""Chains with joints that slide; apart from the compiled kernels, which know angles alone."""
