"""Compiled functions: the decorator, the cache of compiled code, and compilation ahead of use."""
