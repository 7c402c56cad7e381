"""Records of episodes: fields, metrics, causes of failure, folders and schema."""
