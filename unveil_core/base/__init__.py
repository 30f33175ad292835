"""What everything stands on: files, errors, progress, threads. Knows nothing of drives or scenes."""
