"""Plans that a network gives at once, and the Gauss-Newton steps that it is trained with and corrected by."""
