"""The report's page: one HTML file with tables, plots, replays and pictures."""
