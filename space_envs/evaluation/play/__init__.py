"""Policies on tasks: episodes in chunks, in any process, with the same result."""
