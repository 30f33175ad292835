"""What lies around a drive is not obeyed: the working folder may be a stranger's."""
