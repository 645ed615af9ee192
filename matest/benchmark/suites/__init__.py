"""What `matest benchmark` runs, one file a suite."""
