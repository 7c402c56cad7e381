"""The page of shyam2020: its claims, tables, figures and files."""
