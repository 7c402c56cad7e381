"""Code shared by the planners of one and of two arms."""
