"""The base of all packages: files, errors, progress, threads. Independent of drives and scenes."""
