"""Episodes as datasets: storage, recording, cards and Minari."""
