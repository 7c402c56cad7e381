"""Visual geometry, without effect on the dynamics: satellites, arms, targets, the planet and the stars."""
