"""Roll-outs of paths in the reaction null space, with their derivatives, as compiled code."""
