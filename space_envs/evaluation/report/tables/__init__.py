"""The leaderboard as a terminal table, Markdown, CSV and LaTeX."""
