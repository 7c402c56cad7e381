"""Libraries of optimal motions over the goals of the train split, made anew."""
