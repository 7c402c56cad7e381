"""What the planners of one and of two arms share."""
