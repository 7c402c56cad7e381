"""Libraries of reactionless motions over the goals of the train split, and how they are made."""
