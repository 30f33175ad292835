"""What a drive's files name, against what lies there: pictures under other names, masks that nothing names, what is not read."""
