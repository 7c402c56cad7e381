"""Reading of robots from description files."""
