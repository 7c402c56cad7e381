"""Statistics of samples of episodes, whose strata are the seeds."""
