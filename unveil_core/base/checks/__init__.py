"""What files of strangers claim and name, checked before anything is made of it."""
