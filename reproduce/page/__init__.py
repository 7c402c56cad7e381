"""The page of a paper: its blocks, its text, its figures, and how it is written."""
